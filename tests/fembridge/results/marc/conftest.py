"""Post files for tests: recorded ones, and a writer of others."""

import sys
from pathlib import Path

import pytest

HERE, FIXTURES = Path(__file__).parent, Path(__file__).parents[4] / "fixtures"
sys.path.insert(0, str(HERE))  # where post_writer and stress_models are


@pytest.fixture(scope="session")
def write_post(tmp_path_factory):
    """A function that writes a file of its own."""
    import post_writer

    folder = tmp_path_factory.mktemp("post")

    def write(storage, model, increments=(), **how):
        path = folder / storage.name
        path.write_bytes(post_writer.post_bytes(storage, model, increments, **how))
        return path

    return write


@pytest.fixture(scope="session")
def marc_samples():
    """The folder of files that Marc wrote."""
    return FIXTURES / "marc_samples"
