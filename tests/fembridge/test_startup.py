"""What an import costs, and what it refuses to live beside."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import fembridge

ROOT = Path(fembridge.__file__).parents[1]
FRD = ROOT / "fixtures/frd_samples/cpe4_ascii.frd"
HEAVY = {"pandas", "scipy", "pymoo", "gmsh", "pygmsh", "meshio", "matplotlib", "rich"}


def python(code, *first_on_path, cwd):
    path = os.pathsep.join([*map(str, first_on_path), str(ROOT)])
    return subprocess.run(
        [sys.executable, "-P", "-c", code],
        cwd=cwd,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


def assert_not_loaded(modules, steps, cwd):
    """None of `modules` is loaded by any of `steps`, one after the other in one process."""
    show = "print('loaded:', *{name.partition('.')[0] for name in sys.modules})"
    done = python("; ".join(["import sys", *(f"{step}; {show}" for step in steps)]), cwd=cwd)
    assert done.returncode == 0, done.stderr
    loaded = [line.split() for line in done.stdout.splitlines() if line.startswith("loaded:")]
    for step, names in zip(steps, loaded, strict=True):
        assert modules.isdisjoint(names), step


def test_import_loads_numpy_and_nothing_heavier(tmp_path):
    steps = [
        "import fembridge",
        "fembridge.Stimulus, fembridge.StressTrace",
        "fembridge.make_stimulus(*fembridge.resolve('noise_5_25_1'))",
        "import fembridge.io.waveform_file, fembridge.host.machine",
        f"fembridge.read({str(FRD)!r}, [11])",
    ]
    assert_not_loaded(HEAVY, steps, tmp_path)


def test_traces_of_a_result_file_load_what_they_need(tmp_path):
    shutil.copy(FRD, tmp_path / "job.frd")
    spared = ["numpy.ma", "hashlib", "json", "tempfile", "tomllib", "logging", "csv", "difflib"]
    code = f"import sys, fembridge; fembridge.read('job.frd', [11]); {spared=}"
    done = python(f"{code}; print(*(name for name in spared if name in sys.modules))", cwd=tmp_path)
    assert (done.returncode, done.stdout.split(), done.stderr) == (0, [], "")


@pytest.mark.slow
def test_stored_answers_load_no_mesher(tmp_path):
    (tmp_path / "own.toml").write_text("[skin]\nepidermis_mm = 0.5\n", encoding="utf-8")
    words = ["simulate", "--stimulus", "sine_20_250", "--stored", "-o", "out", "--no-plot"]
    steps = [
        "import fembridge as fb",
        "fb.simulate('sine_20_250', stored=True)",
        "fb.threshold(['PC'], [250])",
        "fb.deflect()",
        "from fembridge.cli import main",
        f"assert main({words!r}) == 0",
        f"assert main({[*words, '--finger', 'own.toml']!r}) == 1",
    ]
    assert_not_loaded({"gmsh", "pygmsh", "meshio"}, steps, tmp_path)


def test_neural_loads_numpy_and_neither_decks_nor_anything_heavier(tmp_path):
    steps = ["import neural", "[getattr(neural, name) for name in neural.__all__]"]
    assert_not_loaded(HEAVY | {"decks"}, steps, tmp_path)


def test_neural_with_fitted_parameters_needs_numpy_alone(tmp_path):
    """Where no other package can be imported, as on a robot."""
    (tmp_path / "mine.toml").write_text('base = "fitted"\n\n[RA]\ncells = 3\n')
    code = """
import sys
import numpy as np

class Blocked:
    def find_spec(self, name, path=None, target=None):
        top = name.partition(".")[0]
        allowed = {"numpy", "neural", "fembridge", "decks"}
        if top not in sys.stdlib_module_names and top not in allowed:
            raise ModuleNotFoundError(name, name=name)

sys.meta_path.insert(0, Blocked())

from pathlib import Path
from neural import encode_cells, parameter_set
stress_pa = 1e4 * (1 - np.cos(0.1 * np.pi * np.arange(0, 250, 0.1)))
for name in ("published", "fitted", "fitted_pad", Path("mine.toml")):
    parameters = parameter_set(name).parameters
    print(*(len(encode_cells(stress_pa, 0.1, parameters[afferent])[0]) for afferent in parameters))
"""
    done = python(code, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert [line.split() for line in done.stdout.splitlines()] == [
        ["1"] * 3,
        ["10"] * 3,
        ["10"] * 3,
        ["10", "3", "10"],
    ]


def test_verbs_that_only_tell_something_load_no_numpy(tmp_path):
    told = ["--help", "--version", "stimuli", "stimuli --help", "stimuli sine_20 --json"]
    told += ["doctor --help", "plot --help", "plot mesh --help"]
    told += ["simulate --help", "encode --help", "build-deck --help", "run --help"]
    steps = ["import decks", "from fembridge.cli import main"]
    steps += [f"main({words.split()!r})" for words in told]
    assert_not_loaded(HEAVY | {"numpy"}, steps, tmp_path)


@pytest.mark.parametrize(
    ("name", "kind", "code"),
    [("decks", "module", "import fembridge"), ("neural", "package", "import fembridge.errors")],
)
def test_it_refuses_to_start_beside_a_stranger_and_names_the_file(tmp_path, name, kind, code):
    stranger = tmp_path / (f"{name}.py" if kind == "module" else f"{name}/__init__.py")
    stranger.parent.mkdir(exist_ok=True)
    stranger.write_text("raise SystemExit('was imported')\n")
    done = python(code, tmp_path, cwd=tmp_path)
    assert done.returncode == 1
    last_line = done.stderr.splitlines()[-1]
    assert last_line.startswith(f"ImportError: fembridge: {stranger} hides the package")
    assert str(ROOT / name) in last_line


def test_it_refuses_a_stranger_that_was_imported_before(tmp_path):
    (tmp_path / "neural.py").write_text("")
    done = python("import neural, fembridge", tmp_path, cwd=tmp_path)
    assert "neural.py hides the package" in done.stderr


def test_a_half_installed_package_says_what_is_missing(tmp_path):
    (tmp_path / "fembridge/host").mkdir(parents=True)
    for name in ("__init__.py", "host/__init__.py", "host/interrupt.py", "version.py"):
        shutil.copy(ROOT / "fembridge" / name, tmp_path / "fembridge" / name)
    code = (
        f"import sys; sys.path = [p for p in sys.path if p != {str(ROOT)!r}]; "
        f"sys.path.insert(0, {str(tmp_path)!r}); import fembridge"
    )
    done = python(code, cwd=tmp_path)
    assert done.returncode == 1
    assert "ImportError: fembridge: " in done.stderr
    assert "'decks'" in done.stderr


def test_it_starts_through_a_symbolic_link_to_its_folder(tmp_path):
    (tmp_path / "link").symlink_to(ROOT)
    code = (
        f"import sys; sys.path = [p for p in sys.path if p != {str(ROOT)!r}]; "
        f"sys.path.insert(0, {str(tmp_path / 'link')!r}); import fembridge; "
        "print(fembridge.__file__)"
    )
    done = python(code, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "link" in done.stdout


def test_every_public_name_is_listed_and_an_unknown_one_is_an_attribute_error():
    for name in dir(fembridge):
        assert getattr(fembridge, name, None) is not None, name
    assert set(fembridge.__all__) <= set(dir(fembridge))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        fembridge.nothing  # noqa: B018 - the access is what is tested
