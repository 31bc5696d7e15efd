"""Other fingers through gmsh: sound meshes, the stored ones again, or one error; halves."""

import builtins
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from decks.finger import LAYERS, AfferentSite, Resolution
from decks.mesh import Mesh, write_mesh
from decks.mesher import graded, mesh_finger, snapped
from decks.presets import PRESETS, QUICK, finger_from, stored_mesh
from fembridge.errors import FingerError, MissingError

try:
    import gmsh
except (ImportError, OSError) as error:
    gmsh, absence = None, f"gmsh cannot be imported: {error}"
else:
    absence = ""
needs_gmsh = pytest.mark.skipif(gmsh is None, reason=absence or "gmsh is here")

FINGERS = {
    "no ridges": {"ridges": {"height_mm": 0}},
    "thick epidermis": {
        "skin": {"epidermis_mm": 0.6},
        "resolution": {"far_mm": 0.45},
        "afferents": {"SA": {"depth_mm": 0.78}, "RA": {"depth_mm": 0.72}, "PC": {"depth_mm": 2.2}},
    },
    "small": {
        "outline": {"half_width_mm": 6, "half_height_mm": 5},
        "bone": {"half_width_mm": 2, "half_height_mm": 1.5, "depth_mm": 6},
    },
    "finer": {"resolution": {"contact_mm": 0.03, "ridge_mm": 0.0625, "far_mm": 0.4}},
    "coarser": {
        "resolution": {"contact_mm": 0.0625, "far_mm": 0.8, "epidermis_rows": 5, "dermis_rows": 4},
        "afferents": {"SA": {"depth_mm": 0.57}, "RA": {"depth_mm": 0.5}},
    },
    "an afferent aside": {"base": "quick", "afferents": {"RA": {"x_mm": -0.375, "depth_mm": 0.5}}},
}
SLOW = pytest.mark.slow


def is_as_stored(path, name):
    """Whether a mesh has the bytes of the stored one, which is of gmsh 4.15.2 on x86-64."""
    if gmsh.__version__ != "4.15.2":  # another one may place nodes otherwise
        pytest.skip(f"gmsh is {gmsh.__version__}, the stored meshes are of 4.15.2")
    return path.read_bytes() == stored_mesh(name).read_bytes()


@needs_gmsh
@pytest.mark.slow
def test_a_preset_is_meshed_again_to_the_same_bytes(tmp_path):
    write_mesh(tmp_path / "again.npz", mesh_finger(PRESETS["paper"]))
    assert is_as_stored(tmp_path / "again.npz", "paper")


@needs_gmsh
@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[] if k == "an afferent aside" else SLOW) for k in FINGERS]
)
def test_another_finger_gets_a_sound_mesh_with_its_afferents(kind):
    """`Mesh` checks shapes and cover when it is made."""
    finger = finger_from(FINGERS[kind], kind)
    mesh = mesh_finger(finger)
    assert {LAYERS[number] for number in mesh.layer} == set(LAYERS)
    assert_array_equal(np.sort(mesh.node_mm[:, 0]), np.sort(-mesh.node_mm[:, 0]) + 0.0)
    for site in finger.afferents.values():
        at = mesh.node_mm[mesh.node_at(site)]
        assert tuple(at) == (site.x_mm, -site.depth_mm)
    area_mm2 = np.pi * finger.outline.half_width_mm * finger.outline.half_height_mm
    assert 0.98 * area_mm2 < mesh.area_mm2().sum() < area_mm2


@needs_gmsh
def test_a_finger_that_gmsh_fails_on_is_a_finger_error(monkeypatch):
    def fail(*words):
        raise Exception("Invalid boundary mesh")  # as gmsh does: the bare class

    monkeypatch.setattr(gmsh.model.mesh, "generate", fail)
    monkeypatch.setattr("decks.mesher._STRETCHES", (1.0,))
    with pytest.raises(FingerError, match="cannot mesh this finger: Invalid boundary"):
        mesh_finger(QUICK)
    assert not gmsh.isInitialized()


@needs_gmsh
def test_an_open_session_of_the_caller_is_left_alone():
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Verbosity", 0)
        gmsh.model.add("theirs")
        with pytest.raises(FingerError, match="gmsh is already at work here"):
            mesh_finger(QUICK)
        assert gmsh.isInitialized()
        assert gmsh.model.getCurrent() == "theirs"
    finally:
        gmsh.finalize()


SIGNALS = """
import os, pathlib, signal, sys, threading
from decks.mesh import write_mesh
from decks.mesher import mesh_finger
from decks.presets import QUICK
signal.signal(signal.SIGTERM, lambda *_: print("SIGTERM", flush=True))
handler, meshes = signal.getsignal(signal.SIGINT), []
thread = threading.Thread(target=lambda: meshes.append(mesh_finger(QUICK)))
thread.start()
thread.join()
write_mesh(pathlib.Path(sys.argv[1]), meshes[0])
print(signal.getsignal(signal.SIGINT) is handler)
os.kill(os.getpid(), signal.SIGTERM)
reader, writer = os.pipe()
os.close(reader)
try:
    os.write(writer, b"to nobody")
except BrokenPipeError:
    print("SIGPIPE")
"""


@pytest.mark.slow
@needs_gmsh
def test_a_thread_meshes_a_preset_to_the_same_bytes_and_leaves_handlers_of_signals(tmp_path):
    """In a process of its own: gmsh changes them when it first begins."""
    words = [sys.executable, "-c", SIGNALS, tmp_path / "again.npz"]
    ran = subprocess.run(words, capture_output=True, text=True)
    assert (ran.returncode, ran.stdout.split()) == (0, ["True", "SIGTERM", "SIGPIPE"])
    assert is_as_stored(tmp_path / "again.npz", "quick")


# ---- Without gmsh


def test_a_resolution_that_no_solver_takes_is_refused_before_gmsh_starts(monkeypatch):
    monkeypatch.setitem(sys.modules, "gmsh", None)
    finest = Resolution(contact_mm=0.005, ridge_mm=0.005, far_mm=0.005)
    finger = replace(QUICK, resolution=finest)
    with pytest.raises(FingerError, match=r"makes about \d{7} elements, expected at"):
        mesh_finger(finger)


def absent(monkeypatch, error):
    """Let ``import gmsh`` fail with `error`, as where it is not or half installed."""
    real = builtins.__import__

    def refuse(name, *words, **more):
        if name in ("gmsh", "pygmsh"):
            raise error
        return real(name, *words, **more)

    monkeypatch.delitem(sys.modules, "gmsh", raising=False)
    monkeypatch.delitem(sys.modules, "pygmsh", raising=False)
    monkeypatch.setattr(builtins, "__import__", refuse)


def test_without_its_system_libraries_the_packages_are_named(monkeypatch):
    absent(monkeypatch, OSError("libGLU.so.1: cannot open shared object file"))
    with pytest.raises(MissingError) as caught:
        mesh_finger(QUICK)
    message = str(caught.value)
    assert "libGLU.so.1" in message
    assert message.endswith(
        "apt-get install -y libglu1-mesa libgl1 libxcursor1 libxft2 libxinerama1 libgomp1"
    )


def test_without_pygmsh_the_line_that_installs_it_is_said(monkeypatch):
    absent(monkeypatch, ImportError("No module named 'pygmsh'"))
    with pytest.raises(MissingError, match="No module named 'pygmsh'; pip install py"):
        mesh_finger(QUICK)


@pytest.mark.parametrize(("start_mm", "stop_mm"), [(0.1, 0.4), (0.4, 0.1), (0.2, 0.2)])
def test_graded_steps_fill_the_length_and_grow_from_one_width_to_the_other(start_mm, stop_mm):
    division = graded(6.0, start_mm, stop_mm)
    steps = division.growth ** np.arange(division.count)
    steps *= 6.0 / steps.sum()
    assert division.count % 2 == 0
    assert abs(steps[0] / start_mm - 1) < 0.1
    assert abs(steps[-1] / stop_mm - 1) < 0.1


def half(x_mm=0.0):
    """Four squares of 0.1 mm, x from `x_mm`, the upper row in the epidermis."""
    x, y = np.meshgrid([0.0, 0.1, 0.2], [-0.5, -0.6, -0.7])
    quad = np.array([[3, 4, 1, 0], [4, 5, 2, 1], [6, 7, 4, 3], [7, 8, 5, 4]])
    nodes = np.stack([x.ravel() + x_mm, y.ravel()], -1)
    return Mesh(nodes, quad, np.array([1, 1, 2, 2]))


@given(st.floats(0.0, 0.25), st.floats(0.45, 0.65))
def test_the_axis_and_the_layers_boundaries_stay_where_they_are(x_mm, depth_mm):
    after = snapped(half(), [AfferentSite("epidermis", x_mm, depth_mm)]).node_mm
    assert after[3:].tolist() == half().node_mm[3:].tolist()
    assert after[0, 0] == 0.0


@pytest.mark.parametrize(
    "site",
    [
        AfferentSite("epidermis", 0.1, 0.65),  # below the epidermis
        AfferentSite("nail", 0.1, 0.5),  # no such layer here
    ],
)
def test_nothing_moves_where_elements_would_not_bear_it(site):
    assert snapped(half(), [site]).node_mm.tolist() == half().node_mm.tolist()
