"""One table of a ``.dat``, as CalculiX or Abaqus prints it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from fembridge.typing import FloatArray, IntArray

Wanted = Callable[[str, str], object]
"""Asked of each section, by quantity and set: whether to read it."""

ALL_CONTACT = "all contact elements"
TABLE = "THE FOLLOWING TABLE IS PRINTED"
"""How Abaqus begins a table."""


@dataclass(frozen=True, slots=True, eq=False)
class DatSection:
    """One quantity of one set at one time.

    `label_names` says what `labels` ``(record, 0 to 2)`` are: nothing, a node,
    an element, an element and a point or face. `values` ``(record, column)`` are
    as printed, in units of the deck. `over_time` is False for sections of an
    eigenmode (`mode` is its number) and of a frequency: these have no time, and
    `time_ms` is that frequency times 1000.
    """

    quantity: str
    set_name: str
    columns: tuple[str, ...]
    time_ms: float
    label_names: tuple[str, ...] = ()
    labels: IntArray = field(default_factory=lambda: np.empty((0, 0), dtype=np.int64))
    values: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    over_time: bool = True
    mode: int | None = None

    def __str__(self) -> str:
        return f"{self.quantity} for {of_set(self.set_name)} at {self.time_ms:g} ms"

    def not_finite(self) -> str:
        """Where a value is NaN or infinite; "" where none is."""
        if np.isfinite(self.values).all():
            return ""
        record, column = np.argwhere(~np.isfinite(self.values))[0].tolist()
        labels = zip(self.label_names, self.labels[record].tolist(), strict=True)
        where = ", ".join([str(self), *(f"{name} {label}" for name, label in labels)])
        return f"{where}: {self.columns[column]} is {self.values[record, column]}"

    def filled(self, labels: IntArray, values: FloatArray) -> "DatSection":
        """The section with records ``(record, label)``, and names for all columns of `values`."""
        count, names = values.shape[1] if len(values) else 0, self.columns
        if count and not names:
            names = ("x", "y", "z") if count == 3 else (self.quantity,)
        if count > len(names) == 1:
            names = tuple(f"{names[0]}{k + 1}" for k in range(count))
        columns = names[:count] if count else names
        return replace(self, columns=columns, labels=labels, values=values)


def of_set(set_name: str) -> str:
    """The set in words."""
    return set_name if set_name in (ALL_CONTACT, "") else f"set {set_name}"
