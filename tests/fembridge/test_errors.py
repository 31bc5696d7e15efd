"""The tree of errors: as it is drawn, through a pickle, and on the command line."""

import pickle
from pathlib import Path

import pytest

from fembridge import errors
from fembridge.errors import FembridgeError, StimulusError, UsageError

CLASSES = {
    name: thing
    for name, thing in vars(errors).items()
    if isinstance(thing, type) and issubclass(thing, FembridgeError)
}
PUBLIC = [thing for name, thing in CLASSES.items() if not name.startswith("_")]


@pytest.mark.parametrize("error", PUBLIC, ids=lambda error: error.__name__)
def test_an_error_survives_a_pickle(error):
    path = Path("runs/job.frd")
    wholes = {("not this",): "not this"}
    if issubclass(error, errors._PlacedError):
        wholes = {
            ("cut short", path, None): f"{path}: cut short",
            ("cut short", path, 12): f"{path}:12: cut short",
        }
    for words, shown in wholes.items():
        again = pickle.loads(pickle.dumps(error(*words)))
        assert (type(again), again.args, str(again)) == (error, words, shown)


def test_misuse_is_2_and_all_else_is_1():
    codes = {error: error.exit_code for error in PUBLIC}
    assert {error for error, code in codes.items() if code == 2} == {UsageError, StimulusError}
    assert set(codes.values()) == {1, 2}
