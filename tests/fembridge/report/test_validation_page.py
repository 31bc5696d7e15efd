"""The report as a folder: whole, self-contained, the same numbers everywhere; its figures."""

import csv
import hashlib
import re
import shlex
import tomllib
from dataclasses import replace
from itertools import product
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.evidence import touchsim_rates
from fembridge.plots.spikes import raster_figure
from fembridge.report.rates import EVERY_SET, FAMILIES, OBSERVED, SINES, TOUCHSIM
from fembridge.report.validate import RASTER_STIMULI, repeated_trains
from fembridge.report.validation_page import PAGE, page_text, rasters_figure, regression_figure
from fembridge.tables import AFFERENTS

# Points a figure of 7.2 inches may have at least, so that on the page, where it is
# 8.1 inches wide or more, no letter is below 8 points.
LEAST_PT = 7.0


@pytest.fixture(scope="module")
def page(report):
    """The page as a tree: every tag has its end."""
    return ElementTree.fromstring((report / PAGE).read_text(encoding="utf-8"))


def words(element):
    return "".join(element.itertext())


@pytest.fixture(scope="module")
def tables(page):
    """Rows of cells of each table, by the id of its figure."""
    return {
        figure.get("id"): [[words(cell) for cell in row] for row in figure.iter("tr")]
        for figure in page.iter("figure")
    }


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_a_report_is_a_page_with_numbers_figures_and_a_record(report):
    names = {path.name for path in report.iterdir()}
    assert names == {
        *("index.html", "validation.toml", "rates.csv", "agreement.csv", "rasters.csv"),
        *("thresholds.csv", "entrainment.csv", "locking.csv", "deflection.csv"),
        *("deflection_convergence.csv", "skin_deflection.svg", "rasters.svg"),
        *(f"rates_{family.name}.svg" for family in FAMILIES),
        *(f"regression_{family.name}.svg" for family in FAMILIES),
        *(f"{name}.svg" for name in ("tuning", "phases", "man", "distance", "ramp")),
        *("fingertip_rates.svg", "fingertip_tuning.svg", "fingertip_timing.csv"),
        *("fingertip_tuning.csv", "fingertip_tuning_curves.csv"),
        *("timing.csv", "phases.csv", "tuning.csv", "tuning_curves.csv"),
        *("impulses_in_man.csv", "ramp_and_hold.csv", "distance.csv"),
    }


def test_the_page_loads_nothing_and_its_links_lead_somewhere(page, report):
    assert not [e for e in page.iter() if {"src", "srcset", "data"} & set(e.attrib)]
    text = (report / PAGE).read_text(encoding="utf-8")
    assert "@import" not in text
    assert not re.findall(r"url\((?!#)", text)
    ids = [element.get("id") for element in page.iter() if element.get("id")]
    for link in (element.get("href") for element in page.iter("a")):
        assert link[1:] in ids if link.startswith("#") else (report / link).is_file(), link
    assert len(set(ids)) == len(ids)


def test_every_figure_and_table_has_a_command_that_is_one_and_a_file(page, report):
    from fembridge.cli import _parser

    figures, linked = list(page.iter("figure")), set()
    assert len(figures) > 15
    for figure in figures:
        [line] = map(words, figure.iterfind(".//pre/code"))
        program, *rest = shlex.split(line)
        assert program == "fembridge"
        parser, command = _parser(rest)
        assert command is not None
        parser.parse_args(rest)
        files = [link.get("href") for link in figure.iter("a")]
        assert files
        linked.update(files)
    assert linked == {path.name for path in report.iterdir()} - {PAGE}


def test_names_of_a_user_do_not_become_markup(study, undrawn, tmp_path):
    judged = replace(study.judged, name="own", source="file <b>&amp;.toml")
    text = page_text(replace(study, models=(judged, *study.models[1:])), "a < b & c", tmp_path)
    assert "own: file &lt;b&gt;&amp;amp;.toml" in text
    assert "<code>a &lt; b &amp; c" in text


def by_place(rows):
    """Cells of a table by family and class: its two heads and the heads of rows apart."""
    family, found = None, {}
    for row in rows[2:]:
        if row[0] not in AFFERENTS:
            family, row = row[0].partition(" (")[0], row[1:]
        found[family, row[0]] = row[1:]
    return found


@pytest.mark.parametrize(
    ("table", "sources"),
    [
        ("summary", ("own", "published", "TouchSim")),
        ("fingertip_agreement", ("own", "fingertip", "TouchSim")),
    ],
)
def test_a_table_of_agreement_shows_what_the_table_beside_it_holds(tables, report, table, sources):
    """Of each family against observed rates, or in the second against TouchSim's without any."""
    rows = {
        (row["reference"], row["source"], row["family"], row["afferent"]): row
        for row in rows_of(report / "agreement.csv")
        if row["set"] == EVERY_SET
    }
    shown, compared = by_place(tables[table]), 0
    assert len(shown) == 9
    for family, afferent in product(FAMILIES, AFFERENTS):
        reference = (
            "TouchSim" if (family.name, table) == ("noise", "fingertip_agreement") else OBSERVED
        )
        for number, source in enumerate(sources):
            words = shown[family.title, afferent][4 * number : 4 * number + 4]
            row = rows.get((reference, source, family.name, afferent))
            if row is None or row["count"] == "0":
                assert words == ["none" if row else "", "", "", ""]
                continue
            compared += 1
            numbers = [float(w.replace("−", "-").strip("<")) for w in words]
            names = ("r_squared", "p_value", "rmse_ips", "bias_ips")
            expected = [float(row[name]) for name in names]
            expected[1] = max(expected[1], 0.001)
            for half, *pair in zip((5e-3, 5e-4, 0.05, 0.05), numbers, expected, strict=True):
                assert_allclose(*pair, rtol=0, atol=half * 1.001)
    assert compared == 3 * (3 + 1) + (2 * 3 if reference == "TouchSim" else 0)


def test_goals_are_marked_where_rates_were_observed_and_nowhere_else(tables):
    judged = {("Sinusoids", afferent) for afferent in AFFERENTS} | {("Diharmonics", "SA")}
    for place, cells in by_place(tables["summary"]).items():
        assert set(cells[-2:]) <= ({"met", "not met"} if place in judged else {"–"}), place


def test_rates_are_those_that_came_in_and_those_that_were_computed(report, study):
    rows = rows_of(report / "rates.csv")
    found = {
        (row["source"], row["stimulus"], row["afferent"]): float(row["rate_ips"]) for row in rows
    }
    assert len(found) == len(rows)
    expected = {("TouchSim", one.stimulus, one.afferent): one.rate_ips for one in touchsim_rates()}
    for name, simulation in study.simulations.items():
        expected |= {(name, r.stimulus, r.afferent): r.rate_ips for r in simulation.mean_rates}
    expected |= {("observed", r.stimulus, r.afferent): r.rate_ips for r in study.observed.rates()}
    assert found == expected


def test_the_record_names_the_inputs_and_seals_the_files(report, study):
    record = tomllib.loads((report / "validation.toml").read_text(encoding="utf-8"))
    assert record["judged"] == "own"
    assert record["reference"] == "observed"
    assert record["models"]["own"]["parameters"]["RA"]["tau_ms"] == 40.0
    assert record["observed"]["sha256"] == study.observed.sha256
    assert record["observed"]["file"] == "rates.csv"
    assert record["response"]["finger"]["name"] == "quick"
    beside = {path.name for path in report.iterdir()} - {"validation.toml"}
    assert set(record["files"]) == beside
    for name, digest in record["files"].items():
        assert hashlib.sha256((report / name).read_bytes()).hexdigest() == digest


def regression(study):
    family = FAMILIES[2]
    reference = study.rates.reference(family.stimuli)
    return regression_figure(study.rates, study.agreement, family, reference, "own")


def raster(study):
    """The model's spikes, and the first train of each stimulus again as a recorded one."""
    simulation = study.simulations["own"]
    strongest = next(one for one in simulation.stimuli if one.id == RASTER_STIMULI[-1])
    trains = repeated_trains(simulation)
    return rasters_figure(trains, strongest, trains[::5])


def ramp(study):
    return raster_figure(study.evidence.ramp, waveform=study.evidence.ramp_stimulus)


@pytest.mark.parametrize("figure_of", [regression, raster, ramp])
def test_no_words_overlap_none_leave_the_page_and_all_can_be_read(study, figure_of, check_words):
    check_words(figure_of(study), LEAST_PT)


def test_the_dashed_line_is_the_regression_and_the_grey_one_is_equality(study):
    figure = regression_figure(study.rates, study.agreement, SINES, OBSERVED, "own")
    sources = study.rates.compared(OBSERVED)
    assert sources[-1] == TOUCHSIM
    panels = np.array(figure.axes).reshape(len(sources), len(AFFERENTS))
    for row, source in zip(panels, sources, strict=True):
        for panel, afferent in zip(row, AFFERENTS, strict=True):
            observed = study.rates.of(OBSERVED, afferent, SINES.stimuli)
            predicted = study.rates.of(source, afferent, SINES.stimuli)
            line = next(one for one in panel.lines if one.get_linestyle() == "--")
            slope, intercept = np.polyfit(observed, predicted, 1)
            assert_allclose(line.get_ydata(), slope * line.get_xdata() + intercept, atol=1e-9)
            assert panel.get_xlim() == panel.get_ylim()


def test_recorded_spikes_have_rows_of_their_own_below_the_model_s(study):
    first, *_ = raster(study).axes[3:]
    names = [label.get_text() for label in first.get_yticklabels()]
    assert names == [word for one in RASTER_STIMULI for word in (one, f"{one}, observed")]
