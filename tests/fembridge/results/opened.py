"""What is asked of an open file, in one call, for tests."""

from contextlib import contextmanager

from fembridge.results import nodes
from fembridge.results.byte_file import ByteFile
from fembridge.results.marc_post import PostFile
from fembridge.results.readers import ReadOptions, open_source

PLAIN = ReadOptions()


def read_field(path, quantity, increment="last", options=PLAIN):
    with open_source(path, options) as source:
        return source.field(quantity, increment)


def choose_nodes(path, options=PLAIN, **choice):
    with open_source(path, options) as source:
        return nodes.choose_nodes(source, **choice)


def near_nodes(path, places_mm):
    with open_source(path, PLAIN) as source:
        return nodes.near_nodes(source, places_mm)


@contextmanager
def opened_post(path):
    with ByteFile(path) as file:
        yield PostFile(file)
