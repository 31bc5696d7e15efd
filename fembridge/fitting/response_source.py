"""The response that stress is taken from, and where it is from."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

from decks.finger_file import read_finger
from decks.probe import Probe
from fembridge.errors import ResponseError
from fembridge.response.response_map import FOLDER, MAP_FILE, ResponseMap, read_map, stored_response
from fembridge.typing import Table

# Where ``fembridge simulate`` keeps what it solved, below its output folder.
_SOLVED = "response"


@dataclass(frozen=True, slots=True, eq=False)
class ResponseSource:
    """A response map, the name of its file, and the SHA-256 of that."""

    response: ResponseMap
    name: str
    sha256: str
    stored: bool

    def to_table(self) -> Table:
        """Tell in TOML where the stress comes from, without any path."""
        origin = self.response.origin
        finger = origin.get("finger")
        told: Table = {
            "source": "stored response" if self.stored else "solved response",
            "file": self.name,
            "sha256": self.sha256,
        }
        if isinstance(finger, dict) and "name" in finger:
            told["finger"] = str(finger["name"])
        for key in ("solver", "element", "deck_sha256"):
            if key in origin:
                told[key] = origin[key]
        if self.response.closure_percent == self.response.closure_percent:  # no NaN
            told["closure_percent"] = self.response.closure_percent
        return told


def stored_source(finger: str) -> ResponseSource:
    """Take the stored response of a reference finger, ``quick`` or ``paper``.

    Raises
    ------
    FingerError
        No such finger.
    ResponseError
        No response is stored for it.
    """
    response = stored_response(read_finger(finger), Probe(), "CPE4")
    path = FOLDER / f"{finger}.toml"
    return ResponseSource(response, path.name, _sha256(path), stored=True)


def solved_source(place: Path) -> ResponseSource:
    """Read a response that was solved: its file, its folder, or simulate's output.

    Raises
    ------
    ResponseError
        There is none, or it is no whole response map.
    """
    path = place
    if place.is_dir():
        known = (place / MAP_FILE, place / _SOLVED / MAP_FILE)
        there = [file for file in known if file.is_file()]
        if not there:
            raise ResponseError(
                f"{place}: no {MAP_FILE} here nor in {_SOLVED}/, expected what "
                "`fembridge simulate` keeps of a solved response"
            )
        path = there[0]
    return ResponseSource(read_map(path), path.name, _sha256(path), stored=False)


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
