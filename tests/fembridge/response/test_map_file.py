"""A response map as a file: there and back, sealed, and each way to be damaged."""

import hashlib
import tomllib

import numpy as np
import pytest
import tomli_w

from fembridge.errors import OutputError, ResponseError
from fembridge.response.response_map import FOLDER, MAP_FILE, read_map, write_map


@pytest.fixture
def path(tmp_path, made_map):
    path = tmp_path / MAP_FILE
    write_map(path, made_map())
    return path


def reseal(path, table):
    """Write a table with a checksum that fits, as a program of ill will could."""
    table.pop("sha256", None)
    body = tomli_w.dumps(table)
    digest = hashlib.sha256(body.encode()).hexdigest()
    path.write_text(f'sha256 = "{digest}"\n{body}', encoding="utf-8")


def test_a_map_comes_back_to_the_last_bit(path, made_map):
    written, found = made_map(), read_map(path)

    for name in ("depth_um", "tensor_pa", "force_n_per_mm"):
        np.testing.assert_array_equal(getattr(found, name), getattr(written, name))
    assert found.places == written.places
    assert found.closure_percent == written.closure_percent
    assert found.origin == written.origin


def test_the_same_map_gives_the_same_bytes(path, tmp_path):
    again = tmp_path / "again.toml"
    write_map(again, read_map(path))
    assert again.read_bytes() == path.read_bytes()


def test_the_seal_is_the_sha256_of_all_that_stands_below_it(path):
    first, _, body = path.read_bytes().partition(b"\n")
    assert first == f'sha256 = "{hashlib.sha256(body).hexdigest()}"'.encode()
    assert tomllib.loads(body.decode())["format"] == 1


def test_every_edited_digit_is_found(path):
    """Each number of the file in turn, its first digit moved by one."""
    content = path.read_bytes()
    start = content.index(b"\n") + 1
    digits = [
        k
        for k in range(start, len(content))
        if content[k : k + 1].isdigit() and not content[k - 1 : k].isdigit()
    ]
    assert len(digits) > 60
    for k in digits:
        moved = b"%d" % ((content[k] - ord("0") + 1) % 10)
        path.write_bytes(content[:k] + moved + content[k + 1 :])
        with pytest.raises(ResponseError):
            read_map(path)
    path.write_bytes(content)
    read_map(path)


def test_an_edited_number_is_told_as_such(path):
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("20.0,", "20.5,", 1), encoding="utf-8")
    with pytest.raises(ResponseError) as caught:
        read_map(path)
    assert str(caught.value) == (
        f"{path}: its numbers do not match its checksum: it was edited or cut"
    )


def test_an_edited_checksum_is_found(path):
    content = path.read_bytes()
    other = b"0" if content[10:11] != b"0" else b"1"
    path.write_bytes(content[:10] + other + content[11:])
    with pytest.raises(ResponseError, match="edited or cut"):
        read_map(path)


def test_a_map_without_a_checksum_is_none(path):
    path.write_bytes(path.read_bytes().partition(b"\n")[2])
    with pytest.raises(ResponseError, match="edited or cut"):
        read_map(path)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.999])
def test_a_file_cut_anywhere_is_refused(path, share):
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResponseError, match=f"^{path}: "):
        read_map(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xfe\x00\x01", "not readable as a response map"),
        (b"\x89PNG\r\n\x1a\n", "not readable as a response map"),
        (b"a = " + b"[" * 100_000, "not readable as a response map"),
        (b"[SA]\ntau_ms = 3.0\n", "format None, expected 1"),
        (b'sha256 = "0"\nformat = 2\n', "format 2, expected 1"),
    ],
)
def test_a_foreign_file_is_refused(tmp_path, content, message):
    path = tmp_path / "foreign.toml"
    path.write_bytes(content)
    with pytest.raises(ResponseError, match=f"{path}: {message}"):
        read_map(path)


def test_a_missing_file_and_a_folder_are_told(tmp_path):
    with pytest.raises(ResponseError, match="not readable: No such file"):
        read_map(tmp_path / "nothing.toml")
    with pytest.raises(ResponseError, match="not readable: Is a directory"):
        read_map(tmp_path)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("depth_um", [0.0, 1.0], "not a response map: "),
        ("depth_um", [0.0, 1.0, "deep"], "not a response map: "),
        ("depth_um", None, "not a response map: no 'depth_um'"),
        ("force_n_per_mm", [0.0], "not a response map: .*forces"),
        ("closure_percent", "good", "not a response map: could not convert"),
        ("closure_percent", None, "not a response map: no 'closure_percent'"),
        ("afferents", {}, "not a response map: "),
        ("afferents", 5, "not a response map: "),
        ("origin", None, "not a response map: no 'origin'"),
    ],
)
def test_a_sealed_file_that_holds_no_map_is_refused(path, key, value, message):
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    if value is None:
        del table[key]
    else:
        table[key] = value
    reseal(path, table)
    with pytest.raises(ResponseError, match=f"{path}: {message}"):
        read_map(path)


@pytest.mark.parametrize(
    ("key", "value"), [("node", 0), ("node", "11"), ("xy_pa", [0.0]), ("layer", None)]
)
def test_a_sealed_afferent_that_is_none_is_refused(path, key, value):
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    if value is None:
        del table["afferents"]["SA"][key]
    else:
        table["afferents"]["SA"][key] = value
    reseal(path, table)
    with pytest.raises(ResponseError, match=f"{path}: not a response map: "):
        read_map(path)


def test_a_map_is_written_whole_or_not_at_all(path, made_map):
    before = path.read_bytes()
    with pytest.raises(OutputError, match="a folder stands where a file is wanted"):
        write_map(path.parent, made_map())
    assert path.read_bytes() == before


@pytest.mark.parametrize("name", ["quick", "paper"])
def test_a_shipped_map_is_whole_and_deep_enough_for_the_catalogue(name):
    """250 um is the deepest sinusoid; noise has peaks beyond its RMS."""
    from decks.stimuli import resolve
    from decks.waveform import make_stimulus

    response = read_map(FOLDER / f"{name}.toml")

    deepest_um = max(make_stimulus(entry).displacement_um.max() for entry in resolve(["all"]))
    assert response.deepest_um >= deepest_um
    assert response.closure_percent < 0.5
    assert [place.afferent for place in response.places] == ["SA", "RA", "PC"]
    assert response.origin["finger"]["name"] == name
