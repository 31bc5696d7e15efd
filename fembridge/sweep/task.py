"""What a sweep does: responses to be solved once, and items that read them.

Both are values that a worker on any machine can do; their key is the digest of all
that goes into them, so that the same work has the same folder.
"""

from dataclasses import asdict, dataclass
from functools import cache, cached_property
from pathlib import Path

from decks.finger import Finger
from decks.finger_file import finger_table
from decks.probe import Probe
from decks.stimuli import Entry
from decks.waveform import make_stimulus
from fembridge import __version__
from fembridge.build import stimulus_inputs
from fembridge.stimulus import Stimulus
from fembridge.store import SHORT, digest
from fembridge.sweep.study import Asked
from fembridge.typing import Table
from neural import AfferentParameters, Parameters, parameters_to_table

FORMAT = 1
"""Of what a key is made of; another number, and all is done again."""

SOLVES_FOLDER = "solves"
ITEMS_FOLDER = "runs"
STORED = "stored"
"""In the place of a solver: the responses that are shipped."""


@dataclass(frozen=True, eq=False)
class Response:
    """The indentation of one finger with one probe, to be solved once.

    `solver` is its name and version; ``stored`` takes a shipped response.
    """

    finger: Finger
    probe: Probe
    asked: Asked
    element: str
    depth_um: float
    solver: str
    label: str = ""

    @cached_property
    def key(self) -> str:
        """The digest of all that goes into it."""
        return digest(self.inputs())

    @property
    def place(self) -> Path:
        """Its folder, below that of the sweep."""
        return Path(SOLVES_FOLDER, self.key[:SHORT])

    def inputs(self) -> Table:
        """Tell what it is made of."""
        return {
            "format": FORMAT,
            "fembridge": __version__,
            "solver": self.solver,
            "element": self.element,
            "depth_um": self.depth_um,
            "contact": dict(self.asked),
            "probe": asdict(self.probe),
            "finger": finger_table(self.finger),
        }

    def __str__(self) -> str:
        return f"response {self.label}"


@dataclass(frozen=True, eq=False)
class Item:
    """One row of work: `entries` on a response, by one method, with one set of cells.

    By map it holds all stimuli of the study, as a transient one. `parameters_name`
    is no part of its key: the numbers are.
    """

    response: Response
    method: str
    entries: tuple[Entry, ...]
    preindent_um: float
    seed: int | None
    parameters: Parameters
    parameters_name: str = ""
    label: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", dict(self.parameters))  # it pickles

    @cached_property
    def key(self) -> str:
        """The digest of all that goes into it."""
        own = self._own()
        own["stimuli"] = sorted(own["stimuli"], key=lambda one: str(one["id"]))
        cells = _digest_of_cells(tuple(sorted(self.parameters.items())))
        return digest({**own, "parameters": cells, "response": self.response.key})

    @property
    def place(self) -> Path:
        """Its folder, below that of the sweep."""
        return Path(ITEMS_FOLDER, self.key[:SHORT])

    @property
    def solve_place(self) -> Path:
        """Where a transient is solved: the folder of its motion, whatever the cells."""
        waves = [stimulus_inputs(each) for each in self.stimuli()]
        key = digest({"response": self.response.key, "transient": waves})
        return Path(SOLVES_FOLDER, key[:SHORT])

    def stimuli(self) -> list[Stimulus]:
        """Make the samples of its stimuli."""
        return [
            make_stimulus(entry, preindent_um=self.preindent_um, seed=self.seed)
            for entry in self.entries
        ]

    def inputs(self) -> Table:
        """Tell what it is made of."""
        return {
            **self._own(),
            "parameters": parameters_to_table(self.parameters),
            "response": self.response.inputs(),
        }

    def _own(self) -> Table:
        # Seeds may be longer than any float is exact for.
        stimuli = [
            {
                "id": entry.id,
                "preindent_um": self.preindent_um,
                **entry.numbers(),
                **({} if self.seed is None else {"seed": str(self.seed)}),
            }
            for entry in self.entries
        ]
        return {
            "format": FORMAT,
            "method": self.method,
            "stimuli": stimuli,
            **(_HOW_SOLVED if self.method == "transient" else {}),
        }

    def __str__(self) -> str:
        return self.label


# What makes a transient another one than those before: see decision 0014.
_HOW_SOLVED = {"drive": "spring", "section": "half"}

Task = Response | Item


@cache
def _digest_of_cells(parameters: tuple[tuple[str, AfferentParameters], ...]) -> str:
    """Give the digest of what all items of a study share."""
    return digest(parameters_to_table(dict(parameters)))
