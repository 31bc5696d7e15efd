"""Post files for tests: recorded ones, and a writer of others."""

import importlib.util
import sys
from pathlib import Path

import pytest

from fembridge.results.marc_format.post_file import PostFile

HERE, FIXTURES = Path(__file__).parent, Path(__file__).parents[4] / "fixtures"


@pytest.fixture(scope="session")
def writer():
    """Give the module that writes post files from values a test knows."""
    _module("post_sinks")  # the writer imports it
    return _module("post_writer")


@pytest.fixture(scope="session")
def random_posts():
    """Give the module that draws models and increments for the writer."""
    return _module("post_models")


@pytest.fixture(scope="session")
def write_post(writer, tmp_path_factory):
    """Give a function that writes a file of its own."""
    folder = tmp_path_factory.mktemp("post")

    def write(storage, model, increments=(), **how):
        path = folder / storage.name
        path.write_bytes(writer.post_bytes(storage, model, increments, **how))
        return path

    return write


@pytest.fixture(scope="session")
def marc_samples():
    """Give the folder of files that Marc wrote."""
    return FIXTURES / "marc_samples"


@pytest.fixture(scope="session")
def open_post():
    """Give the reader."""
    return PostFile


def _module(name):
    known = f"fembridge_test_{name}"
    if known not in sys.modules:
        found = importlib.util.spec_from_file_location(known, HERE / f"{name}.py")
        module = importlib.util.module_from_spec(found)
        sys.modules[known] = module  # where its dataclasses look themselves up
        found.loader.exec_module(module)
    return sys.modules[known]
