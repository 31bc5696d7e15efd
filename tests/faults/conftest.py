"""What the faults share: a solver that plays, our command, and the table of faults.

The words that a user is to see stand in ``faults.md`` beside this file; `as_in_table`
holds what the program says against the row that names the test.
"""

import os
import re
import resource
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from fembridge.cli import main

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_name("faults.md")


@dataclass(frozen=True)
class Row:
    """One row of the table: its cells, and the tests that its last cell names."""

    fault: str
    done: str
    seen: str
    survived: str
    tests: tuple[str, ...]

    @property
    def messages(self):
        return re.findall(r"`([^`]+)`", self.seen)


def rows_of_table():
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    rows = []
    for line in lines:
        cells = [cell.strip() for cell in line.strip("|").split(" | ")]
        if line.startswith("| ") and "::" in cells[-1]:
            tests = tuple(re.findall(r"`([^`]+::[^`]+)`", cells[-1]))
            rows.append(Row(*cells[:4], tests))
    return rows


@pytest.fixture(scope="session")
def table():
    return rows_of_table()


@pytest.fixture
def as_in_table(request, table):
    """Check that a line is what the table says of the test that asks."""

    def check(text):
        line = text.partition("\nnext:")[0].strip()  # without the command that follows
        place = Path(request.node.path).relative_to(ROOT / "tests").as_posix()
        asking = (request.node.name, request.function.__name__)
        names = {f"{place}::{name}" for name in asking}
        messages = [m for row in table if names & set(row.tests) for m in row.messages]
        patterns = [".+".join(map(re.escape, m.split("…"))) for m in messages]
        assert any(re.fullmatch(pattern, line) for pattern in patterns), (line, messages)

    return check


@pytest.fixture
def refused(capsys, as_in_table):
    """Run a command that fails: exit code 1 or 2, and the one line of the table."""

    def run(*words, notes=0):
        code = main([str(word) for word in words])
        streams = capsys.readouterr()
        assert code in (1, 2), streams
        assert "impulses/s" not in streams.out
        lines = streams.err.splitlines()
        assert len(lines) == 1 + notes, lines
        assert lines[-1].startswith("fembridge: ")
        as_in_table(lines[-1].removeprefix("fembridge: "))
        return lines[-1]

    return run


@pytest.fixture
def file_size_limit():
    """Refuse to write more than so many bytes to a file, as a full disk would."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    yield lambda most: resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def contents(folder):
    """Every file below `folder`, by its name there."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def files_below():
    return contents


@pytest.fixture(scope="session")
def apart():
    """Run Python in a namespace of its own mounts; nobody else sees them."""
    unshare = shutil.which("unshare")
    if unshare is None:
        pytest.skip("no unshare on the PATH: nothing can be mounted here")
    base = [unshare, "--map-root-user", "--mount", "sh", "-ec"]
    probe = [*base, "mkdir /tmp/_ 2>&- || :; mount -t tmpfs none /tmp"]
    if subprocess.run(probe, capture_output=True).returncode:
        pytest.skip("mounting is not allowed here, not even in a namespace")

    def run(mount, program, *words):
        command = [*base, f'{mount}\nexec "$@"', "sh", sys.executable, "-c", program]
        done = subprocess.run(
            [*command, *map(str, words)],
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run
