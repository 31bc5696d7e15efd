"""Own decks of a study: maps that exist, or decks whose map the sweep solves.

    [[base_decks]]
    map = "map"                                 # a folder of `fembridge map`

    [[base_decks]]
    deck = "mine.inp"                           # a deck for CalculiX
    afferents = { SA = [12, 15], RA = "LINE" }  # or a table, "afferents.csv"
    move = "PROBE,2"

The other keys of a deck are the arguments of `fembridge.map_deck`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from fembridge.errors import UsageError
from fembridge.host.store import sha256_of
from fembridge.response.indentation import depth_for
from fembridge.response.response_map import ResponseMap, map_file, read_map
from fembridge.simulation.deck_response import MapOptions, finish_map, plan_map, write_map_run
from fembridge.solver.settings import Solver
from fembridge.sweeps.fingers import check_below, located_errors
from fembridge.typing import Table

_NO_OPTIONS = ("name", "map", "deck")


@dataclass(frozen=True, slots=True)
class DeckTable:
    """One entry of ``base_decks`` in a study file."""

    map: str | None = None
    deck: str | None = None
    name: str | None = None
    afferents: Any = None  # a table of nodes by class, or a text
    depth_um: float | None = None
    retract_um: float | None = None
    steps: int | None = None
    amplitude: str | None = None
    move: str | None = None
    step: str | None = None
    length_unit: str | None = None
    increments: str | None = None
    shell_face: str | None = None
    newton_per_um: float | None = None
    mpa_per_um: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DeckModel:
    """A deck of a study: its map `path`, or the deck `path` with `options` of `map_deck`.

    `label` names it in the table.
    """

    label: str
    path: Path
    is_map: bool
    options: Mapping[str, Any] = field(default_factory=dict)

    def read_map(self) -> ResponseMap:
        """The map of an entry that has one."""
        return read_map(self.path)

    def plan(self, deepest_um: float) -> tuple[Table, tuple[tuple[str, str], ...], dict[str, Any]]:
        """Inputs of the map, class and unit of its afferents, and the options of `map_deck`.

        A deck without a `depth_um` of its own gets one for stimuli to `deepest_um`.

        Raises
        ------
        FembridgeError
            The map cannot be read, or the deck takes no waveform.
        """
        if self.is_map:
            response = self.read_map()
            units = tuple((site.afferent, site.unit) for site in response.places)
            return {"map_sha256": sha256_of(map_file(self.path))}, units, {}
        options = {"depth_um": depth_for(deepest_um), **self.options}
        plan = plan_map(self.path, MapOptions(**options))
        if plan.base.solver != "calculix":
            raise UsageError(
                f"is for {plan.base.solver}, expected CalculiX; solve its map with your solver and "
                "`fembridge map`, and name its folder as map",
                key="deck",
                found=plan.base.solver,
                expected="calculix",
            )
        inputs = {
            "deck_sha256": plan.sha256,
            "files": {name: sha256_of(self.path.parent / name) for name in plan.rebased.needs},
            "nodes": dict(plan.request.afferents),
            **({} if plan.request.load is None else {"load": asdict(plan.request.load)}),
        }
        return inputs, plan.units, options


def decks_of(entries: Sequence[DeckTable], folder: Path) -> tuple[DeckModel, ...]:
    """The decks of a study; file names are relative to `folder`."""
    decks: list[DeckModel] = []
    for number, entry in enumerate(entries, start=1):
        with located_errors(f"base_decks {number}"):
            options = {
                key: value
                for key, value in asdict(entry).items()
                if value is not None and key not in _NO_OPTIONS
            }
            if (entry.map is None) == (entry.deck is None):
                raise UsageError("needs either a map or a deck", key="map")
            if entry.map is not None and options:
                raise UsageError("is for a deck, a map has its own", key=next(iter(options)))
            name = entry.map or entry.deck or ""
            check_below("map" if entry.deck is None else "deck", name)
            if isinstance(entry.afferents, str) and (folder / entry.afferents).is_file():
                check_below("afferents", entry.afferents)
                options["afferents"] = str(folder / entry.afferents)
            path = folder / name
            label = entry.name or (path.name if entry.deck is None else path.stem)
            if label in [deck.label for deck in decks]:
                raise UsageError("is there twice: give each a name", key="name", found=label)
            decks.append(DeckModel(label, path, entry.deck is None, options))
    return tuple(decks)


def solve_map(path: Path, options: Mapping[str, Any], output: Path, settings: Solver) -> None:
    """Solve the map of the deck `path` in `output`."""
    run = write_map_run(path, output, MapOptions(**options))
    finish_map(run, output, None, settings)
