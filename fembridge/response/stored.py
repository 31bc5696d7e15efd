"""The stored responses of the reference fingers: for machines without a solver.

Each is what the recorded run ``fixtures/response_NAME`` of the repository gave;
``python fixtures/record.py`` makes both again.
"""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from decks.finger import Finger
from decks.finger_file import finger_table
from decks.probe import Probe
from fembridge.errors import ResponseError
from fembridge.response.map_file import read_map
from fembridge.response.response_map import ResponseMap

FOLDER = Path(__file__).parent / "maps"


def stored_response(finger: Finger, probe: Probe, element: str) -> ResponseMap:
    """Give the stored response of exactly this finger, probe and element.

    Raises
    ------
    ResponseError
        None is stored for them: it takes a solver.
    """
    path = FOLDER / f"{finger.name}.toml"
    if not path.is_file():
        names = ", ".join(sorted(file.stem for file in FOLDER.glob("*.toml")))
        raise ResponseError(f"no response is stored for finger {finger.name!r}, only for {names}")
    response = read_map(path)
    made_of = {"finger": finger_table(finger), "probe": asdict(probe), "element": element}
    for part, wanted in made_of.items():
        stored = response.origin.get(part)
        if stored != wanted:
            raise ResponseError(
                f"no response is stored for this {part}: the one of finger "
                f"{finger.name!r} has {_difference(stored, wanted)}"
            )
    return response


def _difference(stored: object, wanted: object, name: str = "") -> str:
    """Tell the first entry that differs: what is stored, and what was asked for."""
    if isinstance(stored, Mapping) and isinstance(wanted, Mapping):
        for key in [*stored, *wanted]:
            if stored.get(key) != wanted.get(key):
                inner = f"{name}.{key}" if name else str(key)
                return _difference(stored.get(key), wanted.get(key), inner)
    return f"{name} {stored!r}, asked for is {wanted!r}".strip()
