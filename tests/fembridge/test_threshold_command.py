"""`fembridge threshold`, the evidence it shows, TouchSim's rates, and a plain search beside it."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import fembridge as fb
from decks.stimuli import CATALOGUE
from fembridge import cli
from fembridge.errors import FembridgeWarning, TableError, UsageError
from fembridge.evidence import (
    CRITERIA,
    DISTANCE,
    THRESHOLDS,
    TOUCHSIM_MODELS,
    published,
    read_evidence,
    touchsim_rates,
)
from fembridge.fitting.response_source import stored_source
from fembridge.fitting.thresholds import (
    Thresholds,
    class_thresholds,
    compare_with_evidence,
    parse_frequencies,
    vibration,
)
from fembridge.trace import AFFERENTS
from neural import encode_cells
from neural.parameters import RisingRaParameters

RA = RisingRaParameters(tau_ms=400.0, step_pa=8000.0, spread=0.5, cells=3)


@pytest.fixture(scope="module")
def response():
    return stored_source("quick").response


def test_a_threshold_is_where_a_plain_search_finds_it(response):
    [frequency_hz] = [40.0]
    found = class_thresholds(response, RA, [frequency_hz], 75.0)

    for row, criterion in enumerate(CRITERIA):
        of_cells = []
        for cell in range(3):
            for amplitude_um in np.geomspace(10.0, 300.0, 300):
                wave = vibration(frequency_hz, amplitude_um, 75.0)
                stress_pa = response.traces(wave)[1].stress_pa
                times_ms = encode_cells(stress_pa, 0.5, RA)[0][cell]
                counted = int(((times_ms > 25.0) & (times_ms <= 125.0)).sum())
                if times_ms.size and (criterion == "absolute" or counted >= 4):
                    of_cells.append(amplitude_um)
                    break
        one = found.iloc[row]
        assert (one["criterion"], one["frequency_hz"]) == (criterion, frequency_hz)
        expected = [np.median(of_cells), min(of_cells), max(of_cells)]
        np.testing.assert_allclose(one.iloc[3:].to_numpy(float), expected, rtol=0.03)


def test_what_even_the_deepest_vibration_does_not_reach_is_no_number(response):
    deaf = RisingRaParameters(tau_ms=400.0, step_pa=9e5)
    found = class_thresholds(response, deaf, [40.0], 75.0)
    assert found["amplitude_um"].isna().all()
    observed = published(THRESHOLDS).table.query("afferent == 'RA' and frequency_hz == 38")
    assert compare_with_evidence(found.assign(frequency_hz=38), observed)["ratio"].isna().all()


def test_frequencies_are_third_octaves_or_a_list():
    assert parse_frequencies("5:12.5") == [5.0, 6.3, 8.0, 10.0, 12.5]
    assert parse_frequencies("10,37") == [10.0, 37.0]
    for words in ("low", "5:x", "900:1000", "2:9000", "1:800", "330:390"):
        with pytest.raises(UsageError) as caught:
            parse_frequencies(words)
        assert (caught.value.argument, caught.value.found) == ("frequencies_hz", words)


@pytest.mark.parametrize("frequency_hz", [1.0, 801.0])
def test_a_frequency_that_nobody_recorded_is_refused(response, frequency_hz):
    with pytest.raises(UsageError) as caught:
        class_thresholds(response, RA, [frequency_hz])
    assert (caught.value.argument, caught.value.found) == ("frequencies_hz", frequency_hz)


def test_a_class_that_there_is_not_is_refused():
    with pytest.raises(UsageError) as caught:
        fb.threshold(["RA", "PX"], "5:10")
    assert (caught.value.argument, caught.value.found) == ("afferents", "PX")


def test_parameters_of_another_finger_or_depth_warn():
    with pytest.warns(FembridgeWarning, match="quick"):
        fb.threshold(["PC"], [250], finger="paper")
    with pytest.warns(FembridgeWarning, match="75"):
        fb.threshold(["PC"], [250], preindent_um=0)


def test_thresholds_come_back_from_their_files(tmp_path):
    observed = published(THRESHOLDS).table.query("afferent == 'PC'")
    made = fb.threshold(["PC"], [2, 40, 250], thresholds=observed, output=tmp_path / "first")
    read = Thresholds.read(tmp_path / "first")
    read.write(tmp_path / "second")
    pd.testing.assert_frame_equal(read.table, made.table)
    assert read.provenance == made.provenance
    assert read.provenance["preindent_um"] == 75.0
    for path in (tmp_path / "first").iterdir():
        assert path.read_bytes() == (tmp_path / "second" / path.name).read_bytes(), path.name


def test_thresholds_are_drawn_into_axes_of_the_caller():
    from matplotlib.figure import Figure

    panel = Figure().subplots()
    assert fb.threshold(["RA"], [20, 40]).plot(ax=[panel]) is panel.figure
    assert panel.lines


def test_the_command_writes_a_table_and_a_picture(tmp_path, capsys):
    own = tmp_path / "own.csv"
    own.write_text("afferent,criterion,frequency_hz,amplitude_um\nPC,absolute,100,1\n")
    words = [
        "threshold",
        "--afferent",
        "PC",
        "--frequencies-hz",
        "40,250",
        "--thresholds",
        str(own),
    ]

    assert cli.main([*words, "-o", str(tmp_path / "out"), "--json"]) == 0

    shown = json.loads(capsys.readouterr().out)["thresholds"]
    table = pd.read_csv(tmp_path / "out/thresholds.csv")
    assert table["amplitude_um"].tolist() == [row["amplitude_um"] for row in shown]
    assert table["frequency_hz"].tolist() == [40, 40, 250, 250]
    assert table["amplitude_um"][2] < table["amplitude_um"][0]
    assert (tmp_path / "out/thresholds.png").stat().st_size > 10_000
    assert read_evidence(own, THRESHOLDS).table["amplitude_um"].tolist() == [1.0]


@pytest.mark.usefixtures("unrendered")
def test_files_are_written_also_where_nobody_reads_what_is_printed(tmp_path, capsys, monkeypatch):
    def left(*words, **how):
        raise BrokenPipeError

    monkeypatch.setattr("builtins.print", left)
    words = ["threshold", "--afferent", "PC", "--frequencies-hz", "20", "-o", str(tmp_path / "out")]
    with pytest.raises(BrokenPipeError):
        cli.main(words)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "thresholds.csv",
        "thresholds.png",
        "thresholds.toml",
    }


def test_a_table_in_the_place_of_a_set_brings_its_source(tmp_path):
    own = tmp_path / "own.csv"
    own.write_text("# Mine,\n# 2026.\ndistance_mm,amplitude_um\n# far\n1.5,40\n", encoding="utf-8")
    found = read_evidence(own, DISTANCE)
    assert found.table.to_dict("list") == {"distance_mm": [1.5], "amplitude_um": [40.0]}
    assert found.source == "Mine, 2026. far"
    named, known = read_evidence(THRESHOLDS, THRESHOLDS), published(THRESHOLDS)
    pd.testing.assert_frame_equal(named.table, known.table, check_dtype=False)
    assert named.source == known.source


def test_another_column_of_evidence_and_a_row_twice_are_named(tmp_path):
    own = tmp_path / "own.csv"
    own.write_text("distance_mm,amplitude_um,unit\n1,40,3\n2,50,3\n", encoding="utf-8")
    with pytest.warns(FembridgeWarning, match="columns not used: unit"):
        read_evidence(own, DISTANCE)
    own.write_text("distance_mm,amplitude_um\n1,40\n2,50\n1,40\n", encoding="utf-8")
    with pytest.warns(FembridgeWarning, match=r"own.csv:4: the same as an earlier row"):
        read_evidence(own, DISTANCE)


@pytest.mark.parametrize(
    ("text", "line", "shown"),
    [
        ("# Mine\ndistance_mm\n1\n", 2, "no column amplitude_um"),
        ("# Mine\ndistance_mm,amplitude_um\n1,wide\n", 3, "'wide'"),
        ("distance_mm,amplitude_um\n# Mine\n1,0\n", 3, "0.01 or more"),
    ],
)
def test_a_wrong_table_of_evidence_is_refused_with_its_line(tmp_path, text, line, shown):
    own = tmp_path / "own.csv"
    own.write_text(text, encoding="utf-8")
    with pytest.raises(TableError, match=shown) as caught:
        read_evidence(own, DISTANCE)
    assert caught.value.line == line


TRIALS = 5  # of each model: fewer do not make whole numbers of spikes


@pytest.mark.parametrize("whole_second", [False, True])
@pytest.mark.parametrize("depth_um", [0.0, 500.0])
def test_each_stimulus_has_a_whole_number_of_spikes_of_each_class(depth_um, whole_second):
    """A row of the other window would leave fractions of spikes."""
    windows_ms = {entry.id: entry.window_ms for entry in CATALOGUE}
    rates = touchsim_rates(depth_um, whole_second=whole_second)
    assert [(rate.stimulus, rate.afferent) for rate in rates] == [
        (entry.id, afferent) for entry in CATALOGUE for afferent in AFFERENTS
    ]
    for rate in rates:
        start_ms, end_ms = (0.0, 1000.0) if whole_second else windows_ms[rate.stimulus]
        count = TOUCHSIM_MODELS[rate.afferent] * TRIALS
        spikes = rate.rate_ips * count * (end_ms - start_ms) / 1000.0
        rounding = 0.0005 * count * (end_ms - start_ms) / 1000.0  # three decimals kept
        assert abs(spikes - round(spikes)) <= rounding + 1e-9, rate


def test_a_depth_that_was_not_computed_is_said():
    with pytest.raises(UsageError, match=r"250.*0 or 500"):
        touchsim_rates(250)


def test_the_repr_names_each_class_also_where_a_cell_has_no_threshold():
    thresholds = fb.threshold(["SA", "PC"], [20, 500])
    assert thresholds.table["least_sensitive_um"].isna().any()
    assert [line.split(":")[0].strip() for line in repr(thresholds).splitlines()[1:]] == [
        "SA",
        "PC",
    ]
    table = thresholds.table.assign(amplitude_um=float("nan"))
    unreached = repr(replace(thresholds, table=table)).splitlines()
    assert len(unreached) == 3
    assert "above" in unreached[1]
