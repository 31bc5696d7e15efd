"""The script for the Python of Mentat or Abaqus, run as users do, with imitations of both."""

import argparse
import ast
import importlib
import json
import math
import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fembridge.commands import export_script
from fembridge.io.trace_table import read_traces

MOCK = Path(__file__).with_name("py_post_mock.py")
DT_S, TIMES = 0.0005, 5
GAUSS = 1 / math.sqrt(3)
POINTS = ((-GAUSS, -GAUSS), (GAUSS, -GAUSS), (-GAUSS, GAUSS), (GAUSS, GAUSS))

# Two squares of side 2, left and right, with numbers far from their indices; 900 and
# 901 are the pressure nodes of Herrmann elements, at the origin as Marc has them.
NODES = [
    [70, 0.0, 0.0], [10, 2.0, 0.0], [40, 4.0, 0.0],
    [50, 0.0, 2.0], [20, 2.0, 2.0], [30, 4.0, 2.0],
    [900, 0.0, 0.0], [901, 0.0, 0.0],
]  # fmt: skip
ELEMENTS = [[7, 80, [70, 10, 20, 50, 900]], [3, 80, [10, 40, 30, 20, 901]]]
CENTRES = ((1.0, 1.0), (3.0, 1.0))
SETS = [["skin", "node", [50, 20]], ["left", "element", [7]], ["right", "element", [3]]]
SCALAR, TENSOR = "Equivalent Von Mises Stress", "Stress"


def at_points(field):
    """Values of ``field(x, y)`` at the integration points, by element."""
    return [[field(x + a, y + b) for a, b in POINTS] for x, y in CENTRES]


def linear(time_s):
    """A field that linear extrapolation must bring back at every node, in MPa."""
    return lambda x, y: 1.0 + 0.25 * x + 0.5 * y + 100.0 * time_s


def shear(time_s):
    """Pure shear, whose von Mises stress is sqrt(3) of it."""
    return lambda x, y: [0.0, 0.0, 0.0, linear(time_s)(x, y), 0.0, 0.0]


def model(**changes):
    times = [DT_S * k for k in range(TIMES)]
    made = {
        "nodes": NODES,
        "elements": ELEMENTS,
        "sets": SETS,
        "positions": [
            {
                "increment": increment,
                "time": time_s,
                "scalars": {SCALAR: at_points(linear(time_s)), "Zeta": []},
                "tensors": {TENSOR: at_points(shear(time_s))},
            }
            for increment, time_s in enumerate(times)
        ],
    }
    return {**made, **changes}


@pytest.fixture
def script(tmp_path):
    """The script and py_post beside it."""
    path = tmp_path / "export.py"
    path.write_text(export_script.script_text(), encoding="utf-8")
    shutil.copy(MOCK, tmp_path / "py_post.py")
    return path


@pytest.fixture
def export(script, tmp_path, monkeypatch, capsys):
    """A function that runs the script on a file, asking Marc's for the stored von Mises stress."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)

    def run(*words, of=None, scalar=True, file="job.t16"):
        (tmp_path / file).write_text(json.dumps(of or model()))
        asked = ("--von-mises", "scalar") if scalar else ()
        for name in ("py_post", "odbAccess", "abaqusConstants"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        importlib.invalidate_caches()
        capsys.readouterr()
        try:
            main = runpy.run_path(str(script))["main"]
            code = main([file, *asked, *map(str, words)])
        except SystemExit as stopped:
            code = stopped.code
        return subprocess.CompletedProcess(words, code, *capsys.readouterr())

    return run


def process(script, file, *words, python=sys.executable):
    """Run the script in a process of its own, as users do."""
    folder = script.parent
    return subprocess.run(
        [python, "-s", str(script), file, *map(str, words)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )


def by_node(path):
    return {trace.node: trace for trace in read_traces(path)}


@pytest.fixture
def traces(export, tmp_path):
    """A function that runs the script well and gives its traces by node."""

    def run(*words, **named):
        ran = export(*words, "-o", "traces.csv", **named)
        assert ran.returncode == 0, ran.stderr
        return by_node(tmp_path / "traces.csv")

    return run


def test_a_linear_field_comes_back_at_every_node(traces):
    """Node 20 lies between the elements, 70 and 30 at corners."""
    found = traces("--nodes", 70, 20, 30)
    assert list(found) == [70, 20, 30]
    for node, x, y in ((70, 0, 0), (20, 2, 2), (30, 4, 2)):
        expected_mpa = [linear(DT_S * k)(x, y) for k in range(TIMES)]
        assert_allclose(found[node].stress_pa, 1e6 * np.array(expected_mpa), rtol=1e-8)
        assert (found[node].start_ms, found[node].dt_ms) == (0.0, 0.5)


def test_von_mises_of_the_mean_tensor_differs_from_the_mean_of_von_mises(traces):
    """The left element is in shear +1, the right in -1: their mean is no stress."""
    opposed = model()
    for position in opposed["positions"]:
        sides = [[[0, 0, 0, sign, 0, 0]] * 4 for sign in (1.0, -1.0)]
        position["tensors"] = {TENSOR: sides}
        position["scalars"] = {SCALAR: [[math.sqrt(3)] * 4] * 2}
    tensor = traces("--nodes", 20, 70, "--von-mises", "tensor", of=opposed)
    assert_allclose(tensor[20].stress_pa, 0.0, atol=1e-6)
    assert_allclose(tensor[70].stress_pa, 1e6 * math.sqrt(3), rtol=1e-8)
    by_default = traces("--nodes", 20, of=opposed, scalar=False)
    assert_allclose(by_default[20].stress_pa, 0.0, atol=1e-6)
    scalar = traces("--nodes", 20, of=opposed)
    assert_allclose(scalar[20].stress_pa, 1e6 * math.sqrt(3), rtol=1e-8)


def test_afferents_are_named_and_come_out_as_encode_reads_them(export, tmp_path):
    assert export("--afferent", "SA=70", "RA=30", "--nodes", 10, 70).returncode == 0
    found = read_traces(tmp_path / "job_traces.csv")
    assert [(t.afferent, t.node) for t in found] == [("SA", 70), ("RA", 30), (None, 10)]


def test_a_set_gives_its_nodes_and_a_place_its_nearest(traces, export):
    assert list(traces("--set", "skin")) == [50, 20]
    assert list(traces("--near", "3.9,1.8", "0.1,0.2")) == [30, 70]
    assert "node 30, 0.2236 away" in export("--near", "3.9,1.8").stderr


def test_a_pressure_node_is_never_the_nearest_and_is_refused_by_number(traces, export):
    """It lies at the origin, where node 70 is: only that one has values."""
    assert list(traces("--near", "0,0,0")) == [70]
    ran = export("--nodes", 900)
    assert (ran.returncode, ran.stdout) == (1, "")
    assert "node 900 has no value in element 7: a pressure node?" in ran.stderr


def test_a_first_increment_without_values_is_left_out_and_told(traces, export):
    """Marc writes no element values in increment 0 unless it is asked to."""
    bare = model()
    bare["positions"][0].update(scalars={}, tensors={})
    trace = traces("--nodes", 70, of=bare)[70]
    assert (trace.start_ms, trace.stress_pa.size) == (0.5, TIMES - 1)
    assert "Equivalent Von Mises Stress" in export("--nodes", 70, of=bare).stderr


def test_values_that_go_missing_later_are_an_error_and_leave_no_file(export, tmp_path):
    torn = model()
    torn["positions"][3]["scalars"] = {}
    ran = export("--nodes", 70, of=torn)
    assert ran.returncode == 1
    assert "position 4: no Equivalent Von Mises Stress" in ran.stderr
    assert not list(tmp_path.glob("job_traces*"))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--nodes", 12345), "no node 12345 in the model"),
        (("--set", "left"), "'left'; the file has skin"),
        (("--nodes", 70, "--within", "skin"), "'skin'; the file has left"),
        (("--nodes", 70, "--within", "right"), "belongs to no element of the set right"),
        (("--nodes", 70, "--label", "Mises"), "'Mises'; the file has"),
        (("--nodes", 70, "-o", "gone/t.csv"), "cannot write gone/t.csv: No such file"),
    ],
)
def test_what_is_not_there_is_named(export, words, said):
    ran = export(*words)
    assert (ran.returncode, ran.stdout) == (1, "")
    assert ran.stderr.startswith("export.py: ")
    assert said in ran.stderr


@pytest.mark.parametrize("words", [(), ("--nodes", "x"), ("--afferent", "XX=1"), ("--near", "1")])
def test_misuse_has_exit_code_2(export, words):
    ran = export(*words)
    assert ran.returncode == 2
    assert "usage:" in ran.stderr


def test_py_post_is_found_under_the_folder_of_mentat(export, tmp_path):
    shared = tmp_path / "mentat" / "shlib" / "win64"
    shared.mkdir(parents=True)
    (tmp_path / "py_post.py").rename(shared / "py_post.py")
    assert export("--nodes", 70, "--mentat", tmp_path / "mentat").returncode == 0


def test_nothing_in_it_is_newer_than_python_2_7_and_it_imports_the_standard_library_alone():
    """What `feature_version` lets through: f-strings, annotations, nonlocal, ..."""
    script = export_script.script_text()
    newer = (
        ast.JoinedStr, ast.AnnAssign, ast.Nonlocal, ast.AsyncFunctionDef, ast.Await,
        ast.YieldFrom, ast.Starred, ast.NamedExpr, ast.MatMult,
    )  # fmt: skip
    allowed, imported = set(), set()
    for node in ast.walk(ast.parse(script, feature_version=(3, 6))):
        if isinstance(node, ast.Call):  # f(*args) is old, [*a] and a, *b = c are not
            allowed |= {id(arg) for arg in node.args}
        assert not isinstance(node, newer) or id(node) in allowed, ast.dump(node)
        if isinstance(node, ast.FunctionDef):
            assert node.returns is None
            assert not node.args.kwonlyargs
            assert all(arg.annotation is None for arg in node.args.args)
        if isinstance(node, ast.Raise):
            assert node.cause is None
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom):
            imported.add(node.module)
    assert script.isascii()
    theirs = {"py_post", "odbAccess", "abaqusConstants"}
    assert imported - theirs == {"__future__", "argparse", "math", "os", "sys"}


def arguments(*words):
    parser = argparse.ArgumentParser()
    export_script.add_arguments(parser)
    parser.add_argument("--json", action="store_true")
    return parser.parse_args(words)


def test_the_verb_prints_writes_or_hands_over_the_script(tmp_path, capsys):
    script = export_script.script_text()
    assert export_script.run(arguments())["output"] is None
    assert capsys.readouterr().out == script
    output = tmp_path / "tools" / "export.py"
    assert export_script.run(arguments("-o", str(output))) == {"output": str(output)}
    assert output.read_text(encoding="utf-8") == script
    capsys.readouterr()
    assert export_script.run(arguments("--json"))["script"] == script
    assert capsys.readouterr().out == ""


ODB = """
import json, math

def sequence(found):
    return [Item(**one) for one in found]

class Item(object):
    def __init__(self, **given):
        self.__dict__.update(given)

class Field(Item):
    componentLabels = ("S11", "S22", "S33", "S12")

    def getSubset(self, region, position):
        assert position == "nodal of each element"
        values = [Item(nodeLabel=node, elementLabel=region.label, data=data, mises=mises(data))
                  for node, data in zip(region.connectivity, self.of[str(region.label)])]
        return Item(values=values)

def mises(s):
    return math.sqrt(((s[0]-s[1])**2 + (s[1]-s[2])**2 + (s[2]-s[0])**2) / 2.0 + 3.0 * s[3]**2)

def openOdb(path, readOnly):
    with open(path) as file:
        held = json.load(file)
    if held.get("broken"):
        raise RuntimeError("written by another release")
    instances, nested = {}, {}
    for name, one in held["instances"].items():
        nodes = sequence(one["nodes"])
        elements = sequence(one["elements"])
        sets = {name: Item(nodes=None, elements=[e for e in elements if e.label in members])
                for name, members in one["layers"].items()}
        instances[name] = Item(nodes=nodes, elements=elements, nodeSets={}, elementSets=sets)
        nested[name] = nodes
    names = sorted(instances)
    everywhere = Item(elements=None, instanceNames=names, nodes=[nested[name] for name in names])
    steps = {}
    for name, frames in sorted(held["steps"].items()):
        frames = [
            Item(
                frameValue=f["t"],
                incrementNumber=k,
                fieldOutputs={"S": Field(of=f["S"])} if f["S"] else {},
            )
            for k, f in enumerate(frames)
        ]
        steps[name] = Item(totalTime=held["starts"][name], frames=frames)
    assembly = Item(instances=instances, nodeSets={"ALL": everywhere}, elementSets={})
    return Item(steps=steps, rootAssembly=assembly, close=lambda: None)
"""


def odb(parts=1, **changes):
    """Two squares side by side, each a layer, in a step of rest and three frames, and another."""
    nodes = [{"label": n, "coordinates": [x, y, 0.0]} for n, x, y in NODES[:6]]
    elements = [{"label": e, "connectivity": corners[:4]} for e, _, corners in ELEMENTS]
    part = {"nodes": nodes, "elements": elements, "layers": {"LEFT": [7], "RIGHT": [3]}}

    def frame(in_step, t):
        stress = {"7": [[t, 0.0, 0.0, 2 * t]] * 4, "3": [[3 * t, 0.0, 0.0, -2 * t]] * 4}
        return {"t": in_step, "S": stress if t else {}}

    steps = {"A": [frame(k * DT_S, k * DT_S) for k in range(4)]}
    steps["B"] = [frame(k * DT_S, (3 + k) * DT_S) for k in range(3)]
    return {
        "instances": {f"PART-{k + 1}-1": part for k in range(parts)},
        "steps": steps, "starts": {"A": 0.0, "B": 3 * DT_S}, **changes,
    }  # fmt: skip


@pytest.fixture
def abaqus(export, script, tmp_path):
    """A function that runs the script on an .odb with the imitation, or in another Python."""
    (tmp_path / "odbAccess.py").write_text(ODB)
    (tmp_path / "abaqusConstants.py").write_text("ELEMENT_NODAL = 'nodal of each element'\n")

    def run(*words, of=None, python=None):
        if python is None:
            return export(*words, of=of or odb(), scalar=False, file="job.odb")
        (tmp_path / "job.odb").write_text(json.dumps(odb()))
        return process(script, "job.odb", *words, python=python)

    return run


def python_2():
    """A Python 2.7 that runs, if one is here."""
    places = [shutil.which("python2.7"), *Path.home().glob(".pyenv/versions/2.7*/bin/python2.7")]
    for place in filter(None, places):
        asked = [str(place), "-c", "import argparse"]
        if subprocess.run(asked, capture_output=True, check=False).returncode == 0:
            return str(place)
    return None


@pytest.mark.parametrize("version", [2, 3])
def test_an_odb_gives_the_von_mises_stress_of_the_mean_over_elements(abaqus, tmp_path, version):
    python = None if version == 3 else python_2()
    if version == 2 and python is None:
        pytest.skip("no Python 2.7 here")
    ran = abaqus("--afferent", "SA=70", "RA=20", "--nodes", 30, "-o", "traces.csv", python=python)
    assert ran.returncode == 0, ran.stderr
    found = {one.node: one for one in read_traces(tmp_path / "traces.csv")}
    assert [one.afferent for one in found.values()] == ["SA", "RA", None]
    assert (found[70].start_ms, found[70].dt_ms) == (0.5, 0.5)  # the first frame has no stress
    times = np.arange(1, 6) * DT_S  # the first frame of a later step is the last one's
    assert_allclose(found[70].stress_pa, 1e6 * math.sqrt(1 + 3 * 4) * times, rtol=1e-8)
    assert_allclose(found[30].stress_pa, 1e6 * math.sqrt(9 + 3 * 4) * times, rtol=1e-8)
    assert_allclose(found[20].stress_pa, 1e6 * 2 * times, rtol=1e-8)
    assert "LEFT | RIGHT" in ran.stderr
    left = abaqus("--nodes", 20, "--within", "LEFT", "-o", "left.csv", python=python)
    assert left.returncode == 0
    (trace,) = read_traces(tmp_path / "left.csv")
    assert_allclose(trace.stress_pa, found[70].stress_pa, rtol=1e-8)


def test_of_several_parts_one_is_named_and_what_is_not_there_too(abaqus, tmp_path):
    ran = abaqus("--nodes", 70, of=odb(parts=2))
    assert ran.returncode == 1
    assert "--instance: PART-1-1, PART-2-1" in ran.stderr
    words = ("--instance", "PART-2-1", "--near", "0.1,0.1", "--set", "ALL")
    ran = abaqus(*words, "-o", "t.csv", of=odb(parts=2))
    assert ran.returncode == 0, ran.stderr
    assert len(read_traces(tmp_path / "t.csv")) == 6
    listed = abaqus("--list")
    assert "positions with results: 6" in listed.stdout
    assert "element set LEFT: 1" in listed.stdout
    assert "no node 5 in the model" in abaqus("--nodes", 5).stderr
    assert "another release" in abaqus("--nodes", 70, of=odb(broken=True)).stderr
    (tmp_path / "odbAccess.py").unlink()
    alone = abaqus("--nodes", 70)
    assert alone.returncode == 1
    assert "abaqus python export.py" in alone.stderr
