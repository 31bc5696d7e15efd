"""What is asked of an open file, in one call, for tests."""

import csv
import re
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

from fembridge import write_vtu_series
from fembridge.results import nodes
from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_post import PostFile
from fembridge.results.read_options import ReadOptions
from fembridge.results.readers import open_source

PLAIN = ReadOptions()


def naming(*shown):
    """A pattern of the values, names or numbers `shown` in a message, in this order."""
    return "(?s)" + ".*?".join(rf"(?<!\w){re.escape(str(value))}(?!\w)" for value in shown)


def shows(text, *shown):
    """Whether `text` has these values in this order."""
    return re.search(naming(*shown), text) is not None


def read_field(path, quantity, increment="last", options=PLAIN):
    with open_source(path, options) as source:
        return source.field(quantity, increment)


def write_table(path, output, options=PLAIN, quantity=None):
    """Columns, and the count of rows."""
    with open_source(path, options) as source:
        return source.write_table(output, quantity)


def choose_nodes(path, options=PLAIN, **choice):
    with open_source(path, options) as source:
        return nodes.choose_nodes(source, **choice)


def near_nodes(path, places_mm):
    with open_source(path, PLAIN) as source:
        return nodes.find_nearest_nodes(source, places_mm)


@contextmanager
def opened_post(path):
    with ByteFile(path) as file:
        yield PostFile(file)


def mesh_of(path):
    with open_source(path, PLAIN) as source:
        return source.mesh()


def sides(path, node, name="", options=PLAIN):
    """Stress in each material."""
    with open_source(path, options) as source:
        return source.sides(node, name)


def pictured(path, folder, **how):
    """Time and mesh of each increment of a file that a series for ParaView lists."""
    import meshio  # not where no picture is made

    series = write_vtu_series(path, folder, **how)
    entries = ElementTree.parse(series).getroot().iter("DataSet")
    return [(float(x.get("timestep")), meshio.read(folder / x.get("file"))) for x in entries]


def rows_of(path):
    with Path(path).open(newline="") as file:
        return list(csv.DictReader(file))


def as_modes(path, code=b" 2", only=b""):
    """Make blocks of a .frd, `only` those of a value, modes: of frequency (2) or buckling (4)."""
    content = bytearray(path.read_bytes())
    at = content.find(b"  100C")
    while at >= 0:
        if only in content[at + 12 : at + 24]:
            content[at + 56 : at + 58], content[at + 63 : at + 73] = code, b"MODAL     "
        at = content.find(b"  100C", at + 1)
    path.write_bytes(content)
    return path
