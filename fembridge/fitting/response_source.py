"""Response that a fit, a study or thresholds are computed on, and the file it comes from."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from decks.presets import read_finger
from decks.probe import Probe
from fembridge.errors import UsageError
from fembridge.host.store import sha256_of
from fembridge.response.response_map import (
    FOLDER,
    ResponseLike,
    ResponseMap,
    load_response,
    map_file,
    read_map,
    stored_response,
)
from fembridge.trace import model_id
from fembridge.typing import Table
from neural.parameter_sets import parameter_set

if TYPE_CHECKING:
    from decks.finger import Finger
    from fembridge.touching.pad import Pad
    from fembridge.touching.pad_probe import PadProbe


@dataclass(frozen=True, slots=True, eq=False)
class ResponseSource:
    """Response map and its file, if any; `stored` where it is shipped with fembridge.

    `units` are those that a user chose, ``SA=12``; of other classes that with the largest stress
    is taken.
    """

    response: ResponseMap
    path: Path | None = None
    stored: bool = False
    units: tuple[str, ...] = ()

    @property
    def parameters(self) -> str:
        """Shipped parameter set that was fitted on such mechanics."""
        return "fitted_pad" if "mechanics" in self.response.origin else "fitted"

    @property
    def preindent_um(self) -> float:
        """Depth of the probe before time 0 by default, in um."""
        return 0.0 if self.response.is_of_deck else parameter_set(self.parameters).preindent_um

    def to_table(self) -> Table:
        """Description of the response map for TOML, without paths."""
        origin, closure_percent = self.response.origin, self.response.closure_percent
        identity = model_id(origin)
        is_of_pad = "mechanics" in origin
        source = "probe on a pad" if is_of_pad else "solved response"
        table = {
            "source": "stored response" if self.stored else source,
            "file": None if self.path is None else self.path.name,
            "sha256": None if self.path is None else sha256_of(self.path),
            "finger": identity.get("name"),
            "finger_sha256": identity.get("sha256"),
            **{key: origin.get(key) for key in ("solver", "element", "deck_sha256")},
            "closure_percent": None if math.isnan(closure_percent) else closure_percent,
            "units": list(self.units) or None,
            **{key: identity.get(key) for key in ("pad", "ridges", "probe")},
            "pad_sha256": origin["pad"].get("sha256") if is_of_pad else None,
            "at_mm": [origin["probe"][key] for key in ("x_mm", "z_mm")] if is_of_pad else None,
            "positions": len(origin["positions_mm"]) if is_of_pad else None,
        }
        return {key: value for key, value in table.items() if value is not None}


def response_source(
    finger: "str | Finger | None" = None,
    response: "ResponseLike | None" = None,
    units: Sequence[str] = (),
    pad: "str | Path | Pad | PadProbe | None" = None,
) -> ResponseSource:
    """Response of a map or file, of a probe on a pad, or the stored one of a finger (``quick``).

    `units` are those of `ResponseMap.with_units`.

    Raises
    ------
    UsageError
        Two of the arguments, a unit that the map lacks, or no such pad.
    ResponseError
        No response is stored for this finger, or a file that is not a response.
    """
    if units:
        source = response_source(finger, response, (), pad)
        return replace(source, response=source.response.with_units(units), units=tuple(units))
    if pad is not None:
        for argument, value in (("finger", finger), ("response", response)):
            if value is not None:
                raise UsageError("cannot be combined with a pad", argument=argument)
        from fembridge.touching.pad_probe import pad_probe

        return ResponseSource(pad_probe(pad).response)
    if response is None:
        return stored_source(finger or "quick")
    if finger is not None:
        raise UsageError("cannot be combined with a response", argument="finger")
    if isinstance(response, str | PathLike):
        return solved_source(Path(response))
    return ResponseSource(load_response(response))


def stored_source(finger: "str | Finger", depth_um: float = 0.0) -> ResponseSource:
    """Stored response of a reference finger, ``quick`` or ``paper``, down to `depth_um`."""
    loaded_finger = read_finger(finger) if isinstance(finger, str) else finger
    response = stored_response(loaded_finger, Probe(), "CPE4", depth_um=depth_um)
    return ResponseSource(response, FOLDER / f"{loaded_finger.name}.toml", stored=True)


def solved_source(path: Path) -> ResponseSource:
    """Solved response from its file, or the output folder of ``map`` or ``simulate``."""
    path = map_file(path)
    return ResponseSource(read_map(path), path, stored=False)
