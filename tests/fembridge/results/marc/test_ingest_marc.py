"""``fembridge ingest`` with Marc's files: post files, decks, status, saved plots."""

import json
from pathlib import Path

import post_writer as writer
import pytest
import stress_models as models
from opened import rows_of, shows

from fembridge.cli import main

FIXTURES = Path(__file__).parents[4] / "fixtures"
FRD = str(FIXTURES / "frd_samples" / "cpe4_ascii.frd")
DECK = str(FIXTURES / "marc_samples" / "pfl_example_model_0.dat")


def stress(x, y, layer, time_s):
    return [1e3 * time_s * (1 + x + 10 * layer), 0, 0, 1e3 * time_s * (y - 1), 0, 0]


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """A current folder with job.t16: two layers, three increments, a set."""
    plane = models.Plane(80, *models.grid(3, 2), layers=[0, 0, 1, 0, 0, 1])
    sets = (("probes", 1, (6, 1), ()), ("soft", 0, (1, 2, 4, 5), ()))
    increments = plane.increments(stress, (0.0, 0.001, 0.002))
    (tmp_path / "job.t16").write_bytes(
        writer.post_bytes(writer.Storage(), plane.model(sets=sets), increments)
    )
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_listing_shows_header_codes_sets_and_times(capsys):
    assert main(["ingest", "job.t16", "--list"]) == 0
    out = capsys.readouterr().out
    for words in (
        "job.t16: marc-t16, ",
        "post revision: 14",
        "byte order: little",
        "codes: 17, 311, 312, 313, 314, 315, 316",
        "element types: 6 of type 80",
        "Stress: SXX, SYY, SZZ, SXY, SYZ, SZX; 3 increments, 0 to 2 ms; at integration",
        "node sets: probes 2",
    ):
        assert words in out
    assert main(["ingest", "job.t16", "--list", "--json"]) == 0
    held = json.loads(capsys.readouterr().out)
    assert held["increments"] == 3
    assert held["problem"] is None


def test_a_boundary_is_refused_crossed_or_read_side_by_side(capsys):
    assert main(["ingest", "job.t16", "--node", "7"]) == 1
    assert shows(capsys.readouterr().err, "node 7", "soft", "elements with ids 2")
    words = ["--across-materials", "-o", "t.csv"]
    assert main(["ingest", "job.t16", "--node", "7", *words]) == 0
    assert main(["ingest", "job.t16", "--node", "7", "--one-sided"]) == 0
    sides = rows_of("job_sides.csv")
    assert {row["material"] for row in sides} == {"soft", "elements with ids 2 1 1 3 1"}
    last = [float(row["xx_pa"]) for row in sides if row["time_ms"] == sides[-1]["time_ms"]]
    assert last == pytest.approx([2e6 * 3, 2e6 * 13], rel=1e-5)


@pytest.mark.parametrize(
    ("words", "shown"),
    [
        (["--list", "--von-mises", "scalar"], {"argument": "--von-mises"}),
        (["--node", "7", "--one-sided", "SOFT"], "'SOFT'"),
        (
            ["--node", "7", "--von-mises", "scalar", "--one-sided"],
            {"argument": "--one-sided", "path": "job.t16"},
        ),
        (["--point", "1:1"], {"argument": "--point", "path": "job.t16"}),
        ([FRD, "--node", "1", "--extrapolate", "average"], "Marc"),
        ([FRD, "--field", "STRESS", "--extrapolate", "average"], "Marc"),
        ([FRD, "--vtu", "v", "--extrapolate", "average"], "Marc"),
        ([FRD, "--node", "1", "--one-sided"], "element set"),
        ([DECK], {"path": str(DECK)}),
    ],
)
def test_words_that_mean_nothing_together_are_misuse(refused, words, shown):
    refused(["ingest", *(words if words[0].startswith("/") else ["job.t16", *words])], shown)


def test_a_deck_is_distinguished_from_prints(capsys):
    assert main(["ingest", DECK, "--list"]) == 0
    out = capsys.readouterr().out
    for words in (
        "example_model_0.dat: marc-deck, ",
        "  elements: 2461 of type 118",
        "  table: name linear_ramp_time1, number 1, line 5135, points 2",
    ):
        assert words in out
