"""Files from users are read up to a bound, and a memory that is too small is one line."""

import pytest

from fembridge.cli import main
from fembridge.errors import DeckError, TableError
from fembridge.host import store
from fembridge.io import text_table
from fembridge.io.observed_rates import read_observed
from fembridge.io.spike_table import read_rates, read_spikes
from fembridge.simulation import encoding
from fembridge.solver import build

ROWS = "stimulus,afferent,rate_ips\n" + "sine_20_250,SA,10.0\n" * 100


@pytest.mark.parametrize("read", [read_rates, read_spikes, read_observed])
def test_a_table_beyond_the_bound_is_refused(tmp_path, monkeypatch, read):
    monkeypatch.setattr(text_table, "MAX_TABLE_BYTES", 1000)
    path = tmp_path / "mine.csv"
    path.write_text(ROWS)
    with pytest.raises(TableError) as refused:
        read(path)
    assert refused.value.path == path
    assert "1000 bytes" in str(refused.value)


def test_a_table_without_an_end_is_refused(monkeypatch):
    monkeypatch.setattr(text_table, "MAX_TABLE_BYTES", 100_000)
    with pytest.raises(TableError):
        text_table.read_table(store.Path("/dev/zero"))


def test_a_base_deck_beyond_the_bound_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "mine.inp"
    path.write_text("*NODE\n" * 100)
    for module in (build, store):  # nodes.py imports it from there when it reads
        monkeypatch.setattr(module, "MAX_DECK_BYTES", 100)
    with pytest.raises(DeckError, match=r"mine\.inp: more than 100 bytes"):
        build.read_base_deck(path)


def test_a_file_that_is_included_over_and_over_ends_in_a_refusal(tmp_path, capsys):
    """Ten lines that include ten others, nine deep, would be ten to the ninth."""
    for k in range(9):
        (tmp_path / f"{k}.inp").write_text(f"*INCLUDE, INPUT={k + 1}.inp\n" * 10)
    (tmp_path / "9.inp").write_text("*NODE\n1, 0, 0\n")
    words = ["--base-deck", str(tmp_path / "0.inp"), "--stimulus", "sine_20_250"]
    more = ["--solver", "calculix", "--afferent", "SA=1", "-o", str(tmp_path / "runs")]
    assert main(["build-deck", *words, *more]) == 1
    assert "more than 1000 files are included" in capsys.readouterr().err


def test_too_little_memory_is_one_line_and_1(monkeypatch, capsys, tmp_path):
    def fill(*_, **__):
        raise MemoryError

    monkeypatch.setattr(encoding, "read_traces", fill)
    assert main(["encode", str(tmp_path / "t.csv"), "-o", str(tmp_path / "out")]) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith("fembridge: ")
