"""A response map as a file: there and back, sealed, and each way to be damaged."""

import hashlib
import tomllib

import pytest
import tomli_w

from fembridge.errors import ResponseError
from fembridge.response.response_map import MAP_FILE, read_map, write_map


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


@pytest.mark.parametrize("share", [0.0, 0.01, 0.1, 0.3, 0.5, 0.7, 0.9, 0.999])
def test_a_file_cut_anywhere_is_refused(path, share):
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResponseError, match=f"^{path}: "):
        read_map(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("depth_um", [0.0, 1.0]),
        ("depth_um", [0.0, 1.0, "deep"]),
        ("afferents", 5),
        ("origin", None),
    ],
)
def test_a_sealed_file_that_holds_no_map_is_refused(path, key, value):
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    if value is None:
        del table[key]
    else:
        table[key] = value
    reseal(path, table)
    with pytest.raises(ResponseError, match=f"^{path}: "):
        read_map(path)
