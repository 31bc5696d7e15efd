"""Two of us in one folder: one has its turn after the other."""

import threading
from pathlib import Path

from fembridge.store import filling, write_text

PATIENCE_S = 0.5
NAMES = ("a.csv", "b.csv", "record.toml")


def fill(folder, text):
    with filling(folder, last="record.toml") as draft:
        for name in NAMES:
            write_text(draft / name, text)


def test_files_of_two_that_write_into_one_folder_are_never_mixed(tmp_path, monkeypatch):
    """The second comes while the first has moved one file of three."""
    second = threading.Thread(target=fill, args=(tmp_path, "second"))
    replace = Path.replace

    def slow(self, target):
        moved = replace(self, target)
        if target == tmp_path / "a.csv" and second.ident is None:
            second.start()
            second.join(PATIENCE_S)
        return moved

    monkeypatch.setattr(Path, "replace", slow)
    fill(tmp_path, "first")
    second.join()

    found = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert found == dict.fromkeys(NAMES, "second")
