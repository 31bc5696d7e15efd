"""Whether two versions of fembridge give the same numbers from the same files.

    python -m benchmarks.same_numbers record PROGRAM FOLDER DATA...
    python -m benchmarks.same_numbers compare FOLDER_A FOLDER_B

`record` has PROGRAM (the path of a ``fembridge``) work on every result file and deck below
the folders DATA, builds decks for every solver, encodes, fits and simulates from the stored
response, one folder a case, all in one process. `compare` holds two such recordings against
each other: exit codes, CSV and decks byte by byte, arrays and JSON value by value. Wording,
and keys that B has beside those of A, are not compared.
"""

import json
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

RESULTS = (".frd", ".t16", ".t19")
PRINTS = (".dat", ".sta", ".cvg", ".sts", ".txt", ".out")
WORDING = {"remarks", "problem", "output", "error", "path", "folder", "message", "fembridge"}
"""Keys of JSON and TOML whose values are wording, a place or a version."""

DECKS = {
    "calculix_all": "--stimulus all",
    "calculix_paper": "--stimulus noise_25_250,sine_20_250 --finger paper",
    "calculix_ascii": "--stimulus sine_50 --results text --element CPE8R --preindent-um 75",
    "calculix_flat": "--stimulus sine_50_50 --probe-shape flat --probe-diameter-mm 2",
    "calculix_whole": "--stimulus sine_50_50 --whole-section --probe-x-mm 0.4",
    "calculix_slide": "--stimulus sine_50_50 --slide-mm-per-s 5",
    "calculix_inertia": "--stimulus sine_50_50 --inertia",
    "calculix_surface": "--stimulus sine_50_50 --contact surface-to-surface --friction 0",
    "calculix_relaxing": "--stimulus sine_50_50 --finger {relaxing} --preindent-um 50",
    "abaqus": "--stimulus sine_50,diharm_10_50 --solver abaqus",
    "abaqus_relaxing": "--stimulus sine_50_50 --solver abaqus --finger {relaxing}",
    "marc": "--stimulus noise_25_250,sine_20_250 --solver marc",
    "marc_meshed": "--stimulus sine_50_50 --solver marc --probe-body meshed --preindent-um 75",
    **{
        f"marc_{kind}": f"--stimulus sine_50_50 --solver marc --element {kind}"
        for kind in ("11", "27", "54", "118")
    },
}
STORED = {
    "stored": "--stimulus all",
    "stored_published": "--stimulus all --parameters published",
    "stored_paper": "--stimulus sine --finger paper",
}
RELAXING = """base = "quick"
[[materials.dermis.prony]]
g = 0.3
tau_s = 0.05
"""
# Fitted to the rates of the stored response: that only exercises the search.
FIT = "--evaluations 400 --population 40 --seed 3 --finger quick"


Case = tuple[str, list[str]]
"""Name and words of a command."""


def cases(data: list[Path], scratch: Path) -> Iterator[Case]:
    """Name and words of each command; ``{relaxing}`` and others are files in `scratch`."""
    (scratch / "relaxing.toml").write_text(RELAXING)
    for name, words in DECKS.items():
        filled = words.format(relaxing=scratch / "relaxing.toml")
        yield f"deck_{name}", ["build-deck", *filled.split(), "-o", "runs"]
    for name, words in STORED.items():
        yield name, ["simulate", *words.split(), "--stored", "--no-plot", "-o", "out"]
    yield "stimuli", ["stimuli", "--json"]
    for kind in ("csv", "wav", "npy", "marc-table"):
        yield f"stimuli_{kind}", ["stimuli", "all", "--export", kind, "-o", "out/"]
    yield "deflect", ["deflect", "-o", "out"]
    yield "validate", ["validate", "-o", "out"]
    for folder in data:
        for path in sorted(folder.rglob("*")):
            if path.suffix.lower() in (*RESULTS, *PRINTS, ".inp"):
                label = "_".join(path.relative_to(folder.parent).parts)
                yield from file_cases(label, path, scratch.parent)


def file_cases(label: str, path: Path, folder: Path) -> Iterator[Case]:
    """What is asked of one file: after its list, which is then in `folder`, what that names."""
    file = str(path)
    if path.suffix.lower() == ".inp" or path.suffix.lower() == ".dat":
        own = ["--base-deck", file, "--afferent", "SA=1", "-o", "runs"]
        yield f"{label}/own", ["build-deck", "--stimulus", "sine_50_50", *own]
        if path.suffix.lower() == ".inp":
            return
    yield f"{label}/list", ["ingest", file, "--list", "--json"]
    yield f"{label}/plain", ["ingest", file, "--json", "-o", "out.csv"]
    yield f"{label}/partial", ["ingest", file, "--partial", "--json", "-o", "out.csv"]
    listed = folder / label / "list"
    held = (
        json.loads((listed / "stdout").read_text()) if (listed / "exit").read_text() == "0" else {}
    )
    quantities = [each for each in held.get("quantities", []) if each.get("nodes")]
    if not quantities and path.suffix.lower() not in RESULTS:
        return
    numbers = [each for q in quantities for each in (q["lowest_node"], q["highest_node"])]
    nodes = [str(each) for each in dict.fromkeys(numbers)] or ["1", "7"]
    ways = [[]]
    if path.suffix.lower() != ".frd":
        ways += [["--extrapolate", each] for each in ("linear", "translate", "average")]
        ways += [["--von-mises", "scalar"], ["--one-sided"]]
        nodes = ["1", "5", "12"]
    for k, way in enumerate(ways):
        for node in nodes:
            words = ["--node", node, "--json", "-o", "out.csv", "--across-materials", *way]
            yield f"{label}/node{node}_{k}", ["ingest", file, *words]
    partial = ["--node", *nodes, "--partial", "--json", "-o", "out.csv"]
    yield f"{label}/nodes_partial", ["ingest", file, *partial]
    yield f"{label}/near", ["ingest", file, "--near-mm=0.1,-0.2", "--json", "-o", "out.csv"]
    for quantity in dict.fromkeys(q["name"] for q in held.get("quantities", [])):
        tail = quantity.lower().replace(" ", "_")
        words = ["--field", quantity, "--json", "-o", "out.npz"]
        yield f"{label}/field_{tail}", ["ingest", file, *words]
    words = ["--vtu", "vtu", "--json", "--derived", "von_mises", "principal"]
    yield f"{label}/vtu", ["ingest", file, *words]


SERVE = """
import contextlib, json, os, sys, traceback
from fembridge.cli import main
for line in sys.stdin:
    place, words = json.loads(line)
    os.chdir(place)
    with (
        open("stdout", "w") as out, contextlib.redirect_stdout(out),
        open("stderr", "w") as err, contextlib.redirect_stderr(err),
    ):
        try:
            code = main(words)
        except BaseException:
            traceback.print_exc()
            code = "died"
    open("exit", "w").write(str(code))
    print(file=sys.__stdout__, flush=True)
"""
"""What the process does: one command after the other, each in its folder."""


def record(program: str, folder: Path, data: list[Path]) -> None:
    """Run every case, each in a folder of its own below `folder`."""
    folder.mkdir(parents=True)
    folder = folder.resolve()
    scratch = folder / "scratch"
    scratch.mkdir()
    # The interpreter beside the program: its environment, wherever this is run.
    process = subprocess.Popen(
        [Path(program).absolute().with_name("python"), "-P", "-c", SERVE],
        cwd=scratch,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stdin is not None and process.stdout is not None
        count = 0
        for name, words in chain(cases(data, scratch), chain_cases(data, folder)):
            place = folder / name
            place.mkdir(parents=True)
            print(json.dumps([str(place), words]), file=process.stdin, flush=True)
            if not process.stdout.readline():
                sys.exit(f"{name}: the process ended")
            count += 1
        process.stdin.close()
    print(f"{count} cases in {folder}")


def chain_cases(data: list[Path], folder: Path) -> Iterator[Case]:
    """From a result over a table to rates, and from rates to parameters."""
    frd = next(
        each / "transient_sine/job.frd" for each in data if (each / "transient_sine").is_dir()
    )
    yield "traces", ["ingest", str(frd), "-o", "traces.csv"]
    traces, rates = folder / "traces/traces.csv", folder / "stored/out/rates.csv"
    for name in ("published", "fitted"):
        words = ["encode", str(traces), "--parameters", name, "--no-raster", "-o", "out"]
        yield f"encode_{name}", words
    for afferent in ("SA", "RA", "PC"):
        words = ["fit", "--observed", str(rates), "--afferent", afferent, "-o", "out"]
        yield f"fit_{afferent}", [*words, *FIT.split()]


def compare(old: Path, new: Path) -> int:
    """Print what differs; the number of cases that do."""
    names = sorted(str(path.parent.relative_to(old)) for path in old.rglob("exit"))
    differ, compared = 0, 0
    for name in names:
        problems = list(differences(old / name, new / name))
        compared += sum(1 for _ in (old / name).rglob("*.*"))
        if problems:
            differ += 1
            print(f"{name}: {'; '.join(problems[:4])}")
    print(f"{len(names)} cases, {compared} files of results, {differ} cases differ")
    return differ


def differences(old: Path, new: Path) -> Iterator[str]:
    """What differs between two recordings of one case."""
    if not (new / "exit").exists():
        yield "not run"
        return
    codes = [(each / "exit").read_text() for each in (old, new)]
    if codes[0] != codes[1]:
        yield f"exit {codes[0]} became {codes[1]}: {(new / 'stderr').read_text()[:200]!r}"
        return
    if (old / "stdout").read_bytes()[:1] == b"{" and codes[0] == "0":
        values = [json.loads((each / "stdout").read_text()) for each in (old, new)]
        yield from (f"stdout {each}" for each in value_differences(*values))
    files = {each: files_of(each) for each in (old, new)}
    for path in sorted(files[old] ^ files[new]):
        yield f"{path} is in one only"
    for path in sorted(files[old] & files[new]):
        if not same_file(old / path, new / path):
            yield f"{path} differs"


def files_of(folder: Path) -> set[str]:
    """Files that a command wrote."""
    printed = {"exit", "stdout", "stderr"}
    found = {str(each.relative_to(folder)) for each in folder.rglob("*") if each.is_file()}
    return found - printed


def same_file(old: Path, new: Path) -> bool:
    """Whether two outputs say the same."""
    content = [each.read_bytes() for each in (old, new)]
    if content[0] == content[1] or old.suffix in (".html", ".svg", ".png"):
        return True
    if old.suffix == ".npz":
        with np.load(old) as a, np.load(new) as b:
            if set(a) != set(b):
                return False
            return all(np.array_equal(a[k], b[k], equal_nan=a[k].dtype.kind == "f") for k in a)
    if old.suffix == ".toml":
        return not list(value_differences(*(tomllib.loads(each.decode()) for each in content)))
    if old.suffix == ".vtu":
        return same_vtu(old, new)
    return False


def same_vtu(old: Path, new: Path) -> bool:
    """Whether two VTU hold the same points, cells and arrays."""
    import meshio

    try:
        a, b = (meshio.read(each) for each in (old, new))
    except Exception as error:  # what meshio makes of cells that it does not know
        print(f"{new}: not compared, meshio: {type(error).__name__}")
        return True
    if not set(a.point_data) <= set(b.point_data) or not set(a.cell_data) <= set(b.cell_data):
        return False
    return np.array_equal(a.points, b.points) and all(
        np.array_equal(a.point_data[k], b.point_data[k], equal_nan=True) for k in a.point_data
    )


def value_differences(old: object, new: object, where: str = "") -> Iterator[str]:
    """Where two values of JSON or TOML differ, but for wording and places."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted(set(old) - WORDING):
            if key not in new:
                yield f"{where}.{key} is gone"
            else:
                yield from value_differences(old[key], new[key], f"{where}.{key}")
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for k, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from value_differences(a, b, f"{where}[{k}]")
    elif old != new and not (old != old and new != new):
        yield f"{where}: {str(old)[:60]} became {str(new)[:60]}"


def main() -> None:
    """Record or compare, as the words ask."""
    if sys.argv[1] == "record":
        record(sys.argv[2], Path(sys.argv[3]), [Path(each).resolve() for each in sys.argv[4:]])
    else:
        sys.exit(min(compare(Path(sys.argv[2]), Path(sys.argv[3])), 1))


if __name__ == "__main__":
    main()
