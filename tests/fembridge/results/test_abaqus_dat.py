"""Tables that Abaqus prints, as public files have them; and those that our deck asks for."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from opened import naming, shows
from own_block import BLOCK

from fembridge import build_deck, map_deck, map_response, read
from fembridge.cli import main
from fembridge.errors import ResultError
from fembridge.io.trace_table import read_traces
from fembridge.response.deck_map import load_unload_of
from fembridge.results.printed import dat_sections, read_point_history, read_point_stress
from fembridge.results.read_options import ReadOptions

TITLE = "1\n{:78}Abaqus 2021  Date 01-Jan-2026\n".format("")
END = "\n          THE ANALYSIS HAS BEEN COMPLETED\n"
AT_NODES = "FOR ELEMENTS WITH TYPE CPE4H BELONGING TO ELEMENT SET {} AVERAGED AT THE NODES"


def number(value, digits=4):
    """As Abaqus prints it: fixed from 0.1 to 10 000, else with an exponent."""
    if value == 0 or 0.1 <= abs(value) < 1e4:
        whole = len(str(int(abs(value)))) if abs(value) >= 1 else 0
        return f"{value:.{digits - whole}f}" + "." * (digits == whole)
    return f"{value:.{digits - 1}E}"


def increment(n, dt_s, tables, step_s=None, total_s=None, step=1):
    step_s = n * dt_s if step_s is None else step_s
    total_s = step_s if total_s is None else total_s
    head = f"\n                  S T E P       {step}     S T A T I C   A N A L Y S I S\n" * (
        n == 1
    )
    return (
        f"{head}\n                                INCREMENT {n:5} SUMMARY\n\n\n"
        f" TIME INCREMENT COMPLETED  {number(dt_s)},  FRACTION OF STEP COMPLETED  0.100\n"
        f" STEP TIME COMPLETED       {number(step_s, 3)},"
        f"  TOTAL TIME COMPLETED        {number(total_s, 3)}\n\n{''.join(tables)}"
    )


def table(preamble, labels, columns, rows, foot="", tail=""):
    body = "".join(
        "".join(f"{label:>12}" for label in whose)
        + f"{foot:>4}"
        + "".join(f"  {number(value):>10}" for value in values)
        + "\n"
        for whose, values in rows
    )
    body = body or "\n      ALL VALUES IN THIS TABLE ARE ZERO\n"
    names = "".join(f"{name:<12}" for name in columns)
    return (
        f"\n   THE FOLLOWING TABLE IS PRINTED {preamble}\n\n"
        f"       {labels}FOOT-   {names}\n            NOTE\n\n{body}{tail}\n"
    )


def nodal(name, nodes, value):
    return table(AT_NODES.format(name), "NODE  ", ["MISES"], [((n,), (value,)) for n in nodes])


@pytest.fixture
def dat(tmp_path):
    def write(*parts, end=END):
        path = tmp_path / "job.dat"
        path.write_text(TITLE + "".join(parts) + end)
        return path

    return write


def test_stress_at_nodes_becomes_traces_on_the_exact_grid(dat, logged):
    """Times past 0.1 s have three digits: 0.2505 is 0.251."""
    stress = [0.001 * (k + 1) for k in range(600)]
    parts = [increment(k + 1, 0.0005, [nodal("SKIN", (4, 7), s)]) for k, s in enumerate(stress)]
    said = logged
    (trace,) = read(dat(*parts), [7])
    assert (trace.start_ms, trace.dt_ms) == (0.5, pytest.approx(0.5, rel=1e-12))
    assert_allclose(trace.stress_pa, 1e6 * np.array(stress), rtol=6e-4)
    assert any(shows(line, ".odb") for line in said)
    with pytest.raises(ResultError, match=naming("job.dat", 5, "4, 7")):
        read(dat(*parts), [5])


def test_a_second_step_begins_where_the_first_ended(dat):
    first = [increment(k, 0.1, [nodal("A", (1,), 1.0 * k)]) for k in (1, 2)]
    later = [
        increment(k, 0.1, [nodal("A", (1,), 2.0 + k)], total_s=0.2 + 0.1 * k, step=2)
        for k in (1, 2)
    ]
    (trace,) = read(dat(*first, *later), [1])
    assert_allclose(trace.times_ms, [100, 200, 300, 400], rtol=1e-12)
    assert_allclose(trace.stress_pa, [1e6, 2e6, 3e6, 4e6], rtol=1e-12)


def test_our_deck_s_run_folder_gives_the_afferents_by_their_own_elements(here):
    """A node may be printed for the elements of another afferent, with a part of its own."""
    (run,) = build_deck("sine_20_250", here, target="abaqus", parameters="published")
    replace(run, increments=60).write()
    nodes = {one.afferent: one.node for one in run.afferents}
    parts = []
    for k in range(1, 61):
        tables = []
        for name, node in nodes.items():
            rows = [((node,), (0.001 * k,)), ((9999,), (1.0,))]
            rows += [((nodes["SA"],), (5.0,))] * (name == "RA")
            tables.append(table(AT_NODES.format(f"AROUND_{name}"), "NODE  ", ["MISES"], rows))
        force = [((3,), (0.5,)), ((8,), (0.25,))]
        name = "FOR NODES BELONGING TO NODE SET PROBE"
        tables.append(table(name, "NODE ", ["RF2"], force, tail="\n TOTAL   0.7500\n"))
        parts.append(increment(k, 0.0005, tables))
    (run.folder / "job.dat").write_text(TITLE + "".join(parts) + END)
    assert main(["ingest", str(run.folder), "-o", "traces.csv"]) == 0
    traces = read_traces(here / "traces.csv")
    assert [one.afferent for one in traces] == ["SA", "RA", "PC"]
    assert (traces[0].start_ms, traces[0].stress_pa.size) == (0.0, 61)
    assert_allclose(traces[0].stress_pa, np.arange(61) * 1e3, rtol=6e-4)
    words = ["--quantity", "total forces", "-o", "f.csv"]
    assert main(["ingest", str(run.folder / "job.dat"), *words]) == 0
    with (here / "f.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = [rows[0][name] for name in ("set", "value", "unit")]
    assert (len(rows), found) == (60, ["PROBE", "0.75", "N"])


def test_a_total_that_is_cut_is_no_number(dat, here):
    name = "FOR NODES BELONGING TO NODE SET PROBE"
    force = table(name, "NODE ", ["RF2"], [((3,), (0.5,))], tail="\n TOTAL   0.7500\n")
    parts = [increment(k, 0.0005, [force]) for k in (1, 2)]
    path = dat(*parts, end="")
    path.write_text(path.read_text().rstrip().removesuffix("500"))
    words = ["ingest", str(path), "--partial", "--quantity", "total forces", "-o", "f.csv"]
    assert main(words) == 0
    assert [row.split(",")[0] for row in (here / "f.csv").read_text().splitlines()[1:]] == ["0.5"]


def test_integration_points_with_footnotes_wrapped_names_and_zeros(dat, logged):
    name = "AT THE INTEGRATION POINTS FOR ELEMENT TYPE CPE4 AND ELEMENT\n     SET A-VERY-LONG-NAME"
    columns = ["S11", "S22", "S33", "S12", "MISES"]
    both = [((13, 1), (1.0, 2.0, 3.0, 0.5, 7.0)), ((13, 2), (2.0, 4.0, 6.0, 1.0, 8.0))]
    parts = [
        increment(1, 0.5, [table(name, "ELEMENT  PT ", columns, [])]),
        increment(2, 0.5, [table(name, "ELEMENT  PT ", columns, both[1:], foot="OR")]),
        increment(3, 0.5, [table(name, "ELEMENT  PT ", columns, both)]),
    ]
    said = logged
    times_ms, points, tensor_pa = read_point_stress(dat(*parts), None, ReadOptions())
    assert times_ms.tolist() == [500, 1000, 1500]
    assert points.tolist() == [[13, 1], [13, 2]]
    assert tensor_pa[:, 0].tolist() == [[0] * 6, [0] * 6, [1e6, 2e6, 3e6, 5e5, 0, 0]]
    assert tensor_pa[1:, 1].tolist() == [[2e6, 4e6, 6e6, 1e6, 0, 0]] * 2
    assert len(said) == 1
    assert shows(said[0], 3, "500 ms, element 13, point 1")
    assert read_point_history(dat(*parts), [(13, 2)]).nodes == (1302,)
    mises = next(dat_sections(dat(*parts), lambda name, _: "mises" in name, ReadOptions()))
    assert (mises.set_name, mises.columns) == ("A-VERY-LONG-NAME", ("MISES",))


def test_a_cut_table_is_refused_and_left_out_when_partial(dat, logged):
    parts = [increment(k, 0.5, [nodal("A", (1, 2), 1.0 * k)]) for k in (1, 2, 3)]
    path = dat(*parts, end="")
    path.write_text(path.read_text().rstrip("\n").rpartition("\n")[0] + "\n")
    with pytest.raises(ResultError, match=naming("job.dat", "line")):
        read(path, [1])
    said = logged
    (trace,) = read(path, [1], partial=True)
    assert trace.stress_pa.tolist() == [1e6, 2e6]
    assert any(shows(line, "THE ANALYSIS HAS BEEN COMPLETED") for line in said)


def test_a_node_in_two_tables_needs_to_be_distinguished(dat):
    parts = [increment(k, 0.5, [nodal("A", (1,), 1.0), nodal("B", (1,), 2.0)]) for k in (1, 2)]
    with pytest.raises(ResultError, match=naming("job.dat", 1, "A", "B")):
        read(dat(*parts), [1])


@pytest.mark.parametrize("bad", ["           1        1.000  2.000\n", "  1e5\n"])
def test_a_line_that_is_no_row_is_refused_by_number(dat, bad):
    broken = nodal("A", (1,), 1.0).replace("           1", bad + "           1", 1)
    with pytest.raises(ResultError, match=r"job\.dat:\d+: "):
        read(dat(increment(1, 0.5, [broken])), [1])


def test_a_printed_load_and_unload_of_an_own_deck_makes_its_map(dat, tmp_path):
    deck = tmp_path / "mine.inp"
    deck.write_text(BLOCK.format(model="", before="", loads="").replace("CPE4", "CPE4H"))
    run = map_deck(deck, tmp_path / "map", afferents={"SA": [5, 6]}, depth_um=50.0)
    assert run.solver == "abaqus"
    depth_um = load_unload_of(run).displacement_um
    path = dat(
        *(
            increment(n, 5e-4, [nodal("FEMBRIDGE_OUTPUT", (5, 6), max(depth, 0.0) * 1e-5)])
            for n, depth in enumerate(depth_um)
            if n
        )
    )
    mapped = map_response(tmp_path / "map", results=path)
    stress_pa = mapped.table["von_mises_pa"].to_numpy()
    expected_pa = 10.0 * np.maximum(mapped.table["depth_um"], 0.0)
    assert_allclose(stress_pa, expected_pa, rtol=1e-3)
    assert mapped.response.lifts_off
