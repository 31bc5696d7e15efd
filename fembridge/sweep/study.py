"""A study: which stimuli on which fingers, with which probes, contacts and methods.

Every combination is a point. Contacts say what is asked of the contact model; what
they leave open follows the ladder of `fembridge.response.solve`.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from decks.analysis import ELEMENTS, Contact
from decks.probe import Probe
from decks.stimuli import MAX_AMPLITUDE_UM, Entry
from fembridge.errors import FembridgeError, UsageError
from fembridge.response.response_map import reading_energy
from fembridge.response.solve import LADDER
from fembridge.simulation import METHODS
from fembridge.sweep.variant import Value, Variant
from neural import ParameterSet, parameter_set

MOST_POINTS = 100_000
"""Of a study; a larger one is a slip of the pen more often than a wish."""

# What the study's file calls them.
_KEYS = {"variants": "fingers", "preindents_um": "preindent_um"}

Asked = Mapping[str, Value]
"""What is asked of a contact model, by the names of `decks.analysis.Contact`."""


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Every combination of stimuli, fingers, probes, contacts, depths and methods.

    `preindents_um` are depths of the probe before time 0; `seed` draws other noise
    than the catalogue's. `stored` takes the stored responses of the reference
    fingers. `text` is what stood in the study's file, for the copy beside the
    results.

    Raises
    ------
    UsageError
        Nothing to do, over `MOST_POINTS` points, or values that do not go together.
    """

    stimuli: tuple[Entry, ...]
    variants: tuple[Variant, ...]
    probes: tuple[Probe, ...] = (Probe(),)
    contacts: tuple[Asked, ...] = ({},)
    methods: tuple[str, ...] = ("map",)
    parameters: ParameterSet = field(default_factory=lambda: parameter_set("fitted"))
    preindents_um: tuple[float, ...] = ()
    seed: int | None = None
    element: str = "CPE4"
    stored: bool = False
    name: str = "study"
    text: str = ""

    def __post_init__(self) -> None:
        if not self.preindents_um:
            object.__setattr__(self, "preindents_um", (self.parameters.preindent_um,))
        for name in ("stimuli", "variants", "probes", "contacts", "methods"):
            if not getattr(self, name):
                raise UsageError(f"{_KEYS.get(name, name)}: none, expected one or more")
        check_points(self.points)
        for name in ("stimuli", "probes", "methods", "preindents_um"):
            [(value, count)] = Counter(getattr(self, name)).most_common(1)
            if count > 1:
                told = _KEYS.get(name, name)
                raise UsageError(f"{told}: {value} stands there twice")
        for method in self.methods:
            if method not in METHODS:
                raise UsageError(f"methods: {method!r}, expected {' or '.join(METHODS)}")
        if self.element not in ELEMENTS:
            raise UsageError(f"element: {self.element!r}, expected one of {', '.join(ELEMENTS)}")
        for depth_um in self.preindents_um:
            if not (math.isfinite(depth_um) and 0 <= depth_um <= MAX_AMPLITUDE_UM):
                raise UsageError(f"preindent_um: {depth_um}, expected 0 to {MAX_AMPLITUDE_UM:g}")
        if self.seed is not None and self.seed < 0:
            raise UsageError(f"seed: {self.seed}, expected 0 or more")
        for asked in self.contacts:
            ladder_of(asked)
        for variant in self.variants:
            if twice := sorted(
                {n for each in self.contacts for n in each}.intersection(variant.contact)
            ):
                raise UsageError(f"contacts: {twice[0]} stands there and among the fingers")
            if variant.contact:
                ladder_of(variant.contact)
        self._check_methods()

    @property
    def points(self) -> int:
        """How many combinations there are."""
        return math.prod(
            len(values)
            for values in (
                self.stimuli,
                self.variants,
                self.probes,
                self.contacts,
                self.preindents_um,
                self.methods,
            )
        )

    def _check_methods(self) -> None:
        if self.stored and "transient" in self.methods:
            raise UsageError("stored: a stored response answers no transient")
        varied = any(each.contact for each in self.variants)
        if self.stored and (varied or any(self.contacts)):
            raise UsageError("contacts: a stored response has its own")
        energy = reading_energy(self.parameters.parameters)
        if energy and "transient" in self.methods:
            raise UsageError(
                f"methods: the drive of {energy} reads strain energy, a transient "
                "gives von Mises stress alone"
            )


def check_points(count: int) -> None:
    """Refuse a study of more than `MOST_POINTS`."""
    if count > MOST_POINTS:
        raise UsageError(
            f"{count} points (stimuli x fingers x probes x contacts x depths x "
            f"methods), expected at most {MOST_POINTS}"
        )


def ladder_of(asked: Asked) -> tuple[Contact, ...]:
    """Give the contact models to try: the ladder's, with what is asked put in.

    Raises
    ------
    UsageError
        A name or a value that no contact model has.
    """
    try:
        rungs = [replace(rung, **asked) for rung in LADDER]  # type: ignore[arg-type]
    except TypeError as error:
        raise UsageError(f"contacts: {error}") from error
    except FembridgeError as error:
        raise UsageError(f"contacts: {error}") from error
    return tuple(dict.fromkeys(rungs))
