"""A cache folder in which anything can be: nothing of others is ever removed or changed.

Each seed makes a folder with entries, changes them in random ways, puts files, folders,
links and pipes of others beside and into them, and uses the cache as runs do.
"""

import os
import random
import shutil
import stat
import tomllib

import pytest

from fembridge.cli import main
from fembridge.errors import UsageError
from fembridge.host import cache
from fembridge.host.store import write_sealed

SEEDS = range(int(os.environ.get("CACHE_SEEDS", "6")))
KEYS = [cache.key_of({"deck": number}) for number in range(6)]
NAMES = ("job.frd", "job.dat")
HOSTILE_NAMES = (
    "../outside/thesis.tex",
    "../../outside/thesis.tex",
    "/etc/passwd",
    "notes/draft.md",
    "..",
    ".",
    "",
    "job.frd\x00",
    "job.frd/",
    "j" * 300,
    "~",
    "*",
    cache.ENTRY_FILE,
)
HOSTILE_VALUES = (None, 1, -1.5, float("nan"), "word", [], [1], {}, {"a": {"b": "c"}}, True, 10**18)


def describe(path):
    """Kind and content of `path`, without following a link."""
    status = path.lstat()
    kind = stat.S_IFMT(status.st_mode)
    if stat.S_ISLNK(kind):
        return kind, path.readlink()
    content = path.read_bytes() if stat.S_ISREG(kind) else b""
    return kind, content


def tree(folder):
    paths = [folder]
    for parent, folders, files in os.walk(folder):
        paths += [folder.joinpath(parent, name) for name in (*folders, *files)]
    return {path: describe(path) for path in paths}


class Attack:
    def __init__(self, tmp_path, seed):
        self.random = random.Random(seed)
        self.cache = tmp_path / "cache"
        self.outside = tmp_path / "outside"
        self.foreign = set()
        self.results = tmp_path / "results"
        for folder in (self.outside, self.results):
            folder.mkdir()
        (self.outside / "thesis.tex").write_text("years of work")
        for number, name in enumerate(NAMES):
            (self.results / name).write_bytes(bytes(2000 * (number + 1)))

    def keep(self, key):
        cache.keep(key, "finger", {"wall_s": 1.0}, [self.results / name for name in NAMES])

    def add_foreign(self, folder):
        names = ["thesis", ".git", self.random.randbytes(16).hex(), "entry.toml.bak", "x" * 32]
        path = folder / self.random.choice(names)
        if os.path.lexists(path):
            return
        kind = self.random.choice(["file", "folder", "link", "pipe", "folder with entry"])
        if kind == "file":
            path.write_bytes(self.random.randbytes(50))
        elif kind == "link":
            path.symlink_to(self.outside)
        elif kind == "pipe":
            os.mkfifo(path)
        else:
            path.mkdir()
            file = path / ("notes.md" if kind == "folder" else cache.ENTRY_FILE)
            file.write_bytes(self.random.randbytes(50))
            self.foreign.add(file)
        self.foreign.add(path)

    def fill_folder(self, path):
        path.mkdir()
        (path / "notes.md").write_text("notes")
        self.foreign.update([path, path / "notes.md"])

    def change_file(self, entry):
        path = entry / self.random.choice([*NAMES, cache.ENTRY_FILE])
        if not path.is_file() or path.is_symlink():
            return
        content = bytearray(path.read_bytes())
        kind = self.random.choice(["bytes", "cut", "gone", "folder", "empty", "pipe", "link"])
        if kind == "bytes":
            for _ in range(self.random.randint(1, 5)):
                content[self.random.randrange(len(content))] = self.random.randrange(256)
            path.write_bytes(content)
            return
        if kind == "cut":
            path.write_bytes(content[: self.random.randrange(len(content))])
            return
        path.unlink()
        if kind == "folder":
            self.fill_folder(path)
        elif kind == "empty":
            path.mkdir()
        elif kind == "pipe":
            os.mkfifo(path)
        elif kind == "link":
            copy = self.outside / f"{len(list(self.outside.iterdir()))}"
            copy.write_bytes(content)
            path.symlink_to(copy)

    def reseal(self, entry):
        path = entry / cache.ENTRY_FILE
        if not path.is_file() or path.is_symlink():
            return
        try:
            table = tomllib.loads(path.read_text())
        except (OSError, ValueError):
            return
        table.pop("sha256", None)
        if self.random.random() < 0.5 and isinstance(table.get("files"), dict):
            for name in self.random.sample(HOSTILE_NAMES, 3):
                table["files"][name] = self.random.choice(["0" * 64, "0", 1])
        else:
            name = self.random.choice(["what", "record", "files", "key", "format"])
            value = self.random.choice(HOSTILE_VALUES)
            table = {key: part for key, part in table.items() if key != name}
            if value is not None:
                table[name] = value
        write_sealed(path, table)

    def link_entry(self, entry):
        target = self.outside / entry.name
        if target.exists():
            return
        shutil.move(entry, target)
        entry.symlink_to(target)
        self.foreign = {path for path in self.foreign if entry not in path.parents}
        self.foreign.add(entry)

    def damage(self):
        entry = self.cache / self.random.choice(KEYS)
        act = self.random.choice(
            [self.add_foreign, self.change_file, self.change_file, self.reseal, self.link_entry]
        )
        if entry.is_dir() and not entry.is_symlink():
            act(entry)
        if self.random.random() < 0.4:
            self.add_foreign(self.cache)

    def use(self, tmp_path):
        for act in self.random.choices(["take", "keep", "list", "room"], k=8):
            key = self.random.choice(KEYS)
            if act == "take":
                place = tmp_path / "place"
                shutil.rmtree(place, ignore_errors=True)
                place.mkdir()
                record = cache.take(key, place)
                files = {path.name: path.read_bytes() for path in place.iterdir()}
                if record is None:
                    assert not files
                else:
                    assert all((self.results / name).read_bytes() == files[name] for name in files)
            elif act == "list":
                assert main(["cache", "--json"]) == 0
            else:
                self.keep(key if act == "keep" else self.random.randbytes(16).hex())


@pytest.fixture
def attack(tmp_path, monkeypatch):
    def begin(seed):
        part = tmp_path / str(seed)
        part.mkdir()
        monkeypatch.setenv(cache.VARIABLE, str(part / "cache"))
        made = Attack(part, seed)
        for key in KEYS:
            made.keep(key)
        for _ in range(6):
            made.damage()
        return made

    monkeypatch.setattr(os, "fsync", lambda handle: None)
    monkeypatch.setattr(cache, "ENTRY_LIMIT_BYTES", 20_000)
    return begin


def test_nothing_of_others_is_removed_or_changed(attack, monkeypatch, tmp_path, capsys):
    """Entries are made, used, evicted and cleared around what is not ours."""
    for seed in SEEDS:
        attacked = attack(seed)
        before = {path: describe(path) for path in attacked.foreign} | tree(attacked.outside)
        monkeypatch.setattr(cache, "LIMIT_BYTES", attacked.random.choice([10_000, 30_000, 10**9]))
        attacked.use(tmp_path)
        assert main(["cache", "--clear"]) == 0
        assert {path: describe(path) for path in before} == before, seed
        assert cache.entries() == []


def test_a_folder_of_others_is_not_touched_at_all(attack, tmp_path, capsys):
    """The same without the mark: it is refused, and stays to the byte."""
    refused = 0
    for seed in SEEDS:
        attacked = attack(seed)
        (attacked.cache / cache.TAG_FILE).unlink()
        before = tree(attacked.cache) | tree(attacked.outside)
        try:
            cache.check_cache()
        except UsageError:
            refused += 1
            for key in KEYS:
                assert cache.take(key, tmp_path) is None
                attacked.keep(key)
            assert main(["cache", "--clear"]) == 2
            assert tree(attacked.cache) | tree(attacked.outside) == before, seed
    assert refused >= len(SEEDS) // 3
