"""What all tests share: no deadlines, and no solver where there is none."""

import os

import pytest
from hypothesis import settings

from fembridge.errors import MissingError
from fembridge.machine import find_ccx

# A person's run takes fewer examples than the checks before a change lands.
EXAMPLES = 100 if os.environ.get("CI") == "true" else 25
settings.register_profile("fembridge", deadline=None, max_examples=EXAMPLES)
settings.load_profile("fembridge")


def pytest_collection_modifyitems(items):
    marked = [item for item in items if item.get_closest_marker("solver")]
    if not marked or solver_is_here():
        return
    absent = pytest.mark.skip(reason="ccx is not on the PATH")
    for item in marked:
        item.add_marker(absent)


def solver_is_here():
    try:
        return find_ccx() is not None
    except MissingError:  # FEMBRIDGE_CCX names something that is no program
        return False
