"""One field of one increment: chosen by its number, written as NPZ or CSV."""

import csv
import re
from pathlib import Path

import numpy as np

from fembridge.errors import ResultError, UsageError
from fembridge.results.field_source import open_source
from fembridge.results.frd_format.field import Field
from fembridge.results.read_options import ReadOptions
from fembridge.store import replacing

LAST = "last"
_CHOICE = re.compile(r"(?:(\d{1,9}):)?(\d{1,9})")
_WORDS = {"": "", "1": "", "%": "percent", "mm/s": "mm_per_s"}
SUFFIXES = (".npz", ".csv")


def read_field(
    path: Path,
    quantity: str,
    increment: str = LAST,
    options: ReadOptions = ReadOptions(),  # noqa: B008 - frozen
) -> Field:
    """Read `quantity` at one increment, without reading those before it.

    Parameters
    ----------
    path
        A ``.frd``, ``.t16`` or ``.t19`` file.
    quantity
        Its name in the file: "STRESS", "DISP", ...; of a Marc file "Displacement",
        "Stress", or a beginning that is one quantity's alone, case-blind.
    increment
        "last", an increment's number, or ``STEP:INCREMENT`` where steps begin
        anew. Of a frequency or buckling step it is the number of the mode. Marc
        has sub-increments in the place of steps.

    Raises
    ------
    UsageError
        `increment` is no such word, or is in more than one step.
    ResultError
        As for `read_fields`; also an increment that is not there.
    """
    chosen = _CHOICE.fullmatch(increment)
    if increment != LAST and chosen is None:
        raise UsageError(f"increment {increment!r}, expected last, N or STEP:N")
    with open_source(path, options) as source:
        held = source.keys(quantity)
        keys = list(held)
        if chosen is not None:
            number = int(chosen[2])
            step = None if chosen[1] is None else int(chosen[1])
            keys = [k for k in keys if k[1] == number and step in (None, k[0])]
            if len(keys) > 1:
                steps = ", ".join(f"{k[0]}:{k[1]}" for k in keys)
                raise UsageError(f"increment {number} is in {len(keys)} steps: {steps}")
        if not keys:
            first, *_, last = [*held, *held]
            raise ResultError(
                f"no increment {increment} of {quantity}, it has {first[0]}:{first[1]} "
                f"to {last[0]}:{last[1]}",
                path,
            )
        return source.field(quantity, keys[-1])


def write_field(path: Path, field: Field) -> None:
    """Write `field` as ``.npz`` or ``.csv``, as the suffix says.

    A CSV has a row for each node, with units in the names of its columns. An NPZ
    has ``nodes``, ``values``, ``components``, ``units``, ``quantity``, ``step``,
    ``increment``, ``axis``, ``axis_value`` and ``time_ms``.

    Raises
    ------
    UsageError
        Another suffix.
    OutputError
        It cannot be written; what stood there before is untouched.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise UsageError(f"{path}: expected a name in {' or '.join(SUFFIXES)}")
    with replacing(path) as draft:
        if suffix == ".npz":
            with draft.open("wb") as out:
                np.savez_compressed(
                    out,
                    quantity=np.array(field.name),
                    step=np.array(field.step),
                    increment=np.array(field.increment),
                    time_ms=np.array(field.time_ms),
                    axis=np.array(field.axis),
                    axis_value=np.array(field.axis_value),
                    components=np.array(field.components),
                    units=np.array(field.units),
                    nodes=field.nodes,
                    values=field.values,
                )
            return
        with draft.open("w", newline="", encoding="utf-8") as text:
            writer = csv.writer(text, lineterminator="\n")
            writer.writerow(["node", *column_names(field)])
            for node, values in zip(field.nodes.tolist(), field.values, strict=True):
                writer.writerow([node, *values.tolist()])


def column_names(field: Field) -> list[str]:
    """Give a name for each component that carries its unit: ``sxx_pa``."""
    names = []
    for component, unit in zip(field.components, field.units, strict=True):
        word = _WORDS.get(unit, unit.lower())
        plain = re.sub(r"\W+", "_", component.lower()).strip("_")
        names.append(f"{plain}_{word}" if word else plain)
    return names
