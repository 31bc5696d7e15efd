"""One table of a ``.dat``, as CalculiX or Abaqus prints it."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from fembridge.trace import MS_PER_S
from fembridge.typing import FloatArray, IntArray

SectionFilter = Callable[[str, str], object]
"""Whether to read a section, given its quantity and set name."""

ALL_CONTACT = "all contact elements"
TABLE = "THE FOLLOWING TABLE IS PRINTED"
"""Beginning of a table in a ``.dat`` of Abaqus."""


@dataclass(frozen=True, slots=True, eq=False)
class DatSection:
    """One quantity of one set at one time.

    `label_names` are the names of the columns of `labels` ``(record, 0 to 2)``: none, node,
    element, or element and point or face. `values` ``(record, column)`` are as printed, in
    units of the deck. `is_over_time` is False for sections of an eigenmode (`mode` is its
    number) and of a frequency: these have no time, and `time_ms` is the frequency times 1000.
    `has_modes` is True after a table of eigenvalues: a steady state then repeats its times.
    """

    quantity: str
    set_name: str
    columns: tuple[str, ...]
    time_ms: float
    label_names: tuple[str, ...] = ()
    labels: IntArray = field(default_factory=lambda: np.empty((0, 0), dtype=np.int64))
    values: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    is_over_time: bool = True
    mode: int | None = None
    has_modes: bool = False

    def __str__(self) -> str:
        return f"{self.quantity} for {set_label(self.set_name)} {self.when}"

    @property
    def when(self) -> str:
        """Its time in ms, its mode, or its frequency in Hz."""
        if self.is_over_time:
            return f"at {self.time_ms:g} ms"
        return f"at {self.time_ms / MS_PER_S:g} Hz" if self.mode is None else f"of mode {self.mode}"

    def not_finite_problem(self) -> str:
        """Message about the first NaN or infinite value; "" if all are finite."""
        if np.isfinite(self.values).all():
            return ""
        record, column = np.argwhere(~np.isfinite(self.values))[0].tolist()
        labels = zip(self.label_names, self.labels[record].tolist(), strict=True)
        where = ", ".join([str(self), *(f"{name} {label}" for name, label in labels)])
        return f"{where}: {self.columns[column]} is {self.values[record, column]}"

    def with_records(self, labels: IntArray, values: FloatArray) -> "DatSection":
        """The section with records ``(record, label)``, and names for all columns of `values`."""
        count, names = values.shape[1] if len(values) else 0, self.columns
        if count and not names:
            names = ("x", "y", "z") if count == 3 else (self.quantity,)
        if count > len(names) == 1:
            names = tuple(f"{names[0]}{k + 1}" for k in range(count))
        columns = names[:count] if count else names
        return replace(self, columns=columns, labels=labels, values=values)


def set_label(set_name: str) -> str:
    """Text that names a set in a message."""
    return set_name if set_name in (ALL_CONTACT, "") else f"set {set_name}"
