"""A study turned into work: points, the items that answer them, their responses."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

from decks.probe import Probe
from decks.stimuli import Entry
from decks.waveform import make_stimulus
from fembridge.errors import FembridgeError, UsageError
from fembridge.response.acceptance import depth_for
from fembridge.sweep.study import Asked, Study
from fembridge.sweep.task import Item, Response
from fembridge.sweep.variant import Value, Variant


@dataclass(frozen=True, slots=True, eq=False)
class Point:
    """One combination of a study: what its rows begin with, and who answers it."""

    columns: Mapping[str, Value | None]
    item: str
    stimulus: str
    afferents: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """All points of a study in the order of its table; items by their keys."""

    points: tuple[Point, ...]
    items: Mapping[str, Item]

    @property
    def columns(self) -> list[str]:
        """Names of the columns that tell a point from another."""
        return list(self.points[0].columns)


def plan_of(study: Study, solver: str) -> Plan:
    """Lay out the work of `study`, to be done with `solver`, a name and a version.

    Raises
    ------
    UsageError
        A stimulus whose samples cannot be made.
    """
    deepest_um = _deepest_um(study)
    points: dict[tuple[str, ...], Point] = {}
    items: dict[str, Item] = {}
    for variant, probe, shared in product(study.variants, study.probes, study.contacts):
        asked = {**shared, **variant.contact}
        responses: dict[float, Response] = {}  # by depth
        label = _label(study, variant, probe, shared)
        for preindent_um, asked_method in product(study.preindents_um, study.methods):
            # Of skin that relaxes there is no map: each waveform is solved.
            method = "transient" if variant.finger.relaxing_s else asked_method
            columns = {
                **_columns(study, variant, probe, shared),
                "preindent_um": preindent_um,
                "method": method,
            }
            for entries in _shares(study, method):
                depth_um = depth_for(max(deepest_um[entry.id, preindent_um] for entry in entries))
                response = responses.setdefault(
                    depth_um,
                    Response(variant.finger, probe, asked, study.element, depth_um, solver, label),
                )
                item = _item(study, response, method, entries, preindent_um)
                items.setdefault(item.key, item)
                afferents = tuple(variant.finger.afferents)
                for entry in entries:
                    points.setdefault(
                        (variant.label, item.key, entry.id),
                        Point(columns, item.key, entry.id, afferents),
                    )
    return Plan(tuple(points.values()), items)


def _columns(study: Study, variant: Variant, probe: Probe, asked: Asked) -> dict[str, Value | None]:
    """Give what is different from point to point, and the usual sizes of the probe."""
    names = dict.fromkeys(n for each in study.variants for n in each.changes)
    asked_names = dict.fromkeys(n for each in study.contacts for n in each)
    flat = any(each.shape == "flat" for each in study.probes)
    return {
        "finger": variant.label,
        **{name: variant.value(name) for name in names},
        "probe_shape": probe.shape,
        "probe_diameter_mm": probe.diameter_mm,
        **({"probe_fillet_mm": probe.fillet_mm} if flat else {}),
        "probe_x_mm": probe.x_mm,
        **{f"contact_{name}": asked.get(name) for name in asked_names},
    }


def _item(
    study: Study, response: Response, method: str, entries: tuple[Entry, ...], preindent_um: float
) -> Item:
    label = f"{response.label}, {method}"
    if method == "transient":
        label = f"{label} {entries[0].id}"
    if len(study.preindents_um) > 1:
        label = f"{label}, held at {preindent_um:g} um"
    return Item(
        response,
        method,
        entries,
        preindent_um,
        study.seed,
        study.parameters.parameters,
        study.parameters.name,
        label,
    )


def _shares(study: Study, method: str) -> list[tuple[Entry, ...]]:
    """Give the stimuli of each item: all by map, one by one as transients."""
    if method == "map":
        return [study.stimuli]
    return [(entry,) for entry in study.stimuli]


def _deepest_um(study: Study) -> dict[tuple[str, float], float]:
    """Give how deep the probe goes, by stimulus and pre-indentation."""
    try:
        return {
            (entry.id, depth_um): float(
                make_stimulus(entry, depth_um, study.seed).displacement_um.max()
            )
            for entry in study.stimuli
            for depth_um in study.preindents_um
        }
    except FembridgeError as error:
        raise UsageError(f"stimuli: {error}") from error


def _label(study: Study, variant: Variant, probe: Probe, asked: Asked) -> str:
    """Tell a response from the others of the study, and no more."""
    told = [str(variant)]
    if len(study.probes) > 1:
        told.append(f"{probe.shape} {probe.diameter_mm:g} mm at x = {probe.x_mm:g} mm")
    told += [f"{name}={value}" for name, value in asked.items()]
    return ", ".join(told)
