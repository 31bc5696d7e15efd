"""The indentation behind a response map: solved, then accepted or rejected.

The probe moves down in steps and returns; unloading must reproduce the stress of loading.
Two errors were measured with ccx 2.20. Surface-to-surface contact is path-dependent:
during unloading the stress at a depth was 17 to 20 % too low. And a thin probe slips
between the skin's nodes: the run converges with the skin untouched.

To 400 um the displacement of each probe node is prescribed; all contact models were
compared under this condition. Deeper, the probe hangs on a stiff spring (see
``decks/calculix.inp.j2``), because with prescribed nodes ccx loses contact during unloading.
With a spring the linear law reaches 1.5 mm, and at every depth to 400 um the stress differs
from that of the prescribed probe by at most 0.01 %.

The contact models of the ladder are tried in order; the first also with a spring and in
smaller steps. Node-to-surface contact with friction returned to its loading curve in every
run to 400 um and takes two iterations per increment. The other models are for meshes on
which it does not converge, in the order of their effect on the stress: softer stick
springs, then no friction (0.3 % at most), softer springs (2 %), and last surface-to-surface
contact. A contact model whose unloading differs from its loading is rejected.

A map is one indentation, read at the depth of each sample. So stress must not depend on
time or position: no layer relaxes, inertia is off, the probe does not slide. This is
checked before solving. The effect of friction is only known afterwards: skin that slips
under the probe during loading does not slip back the same way. Where the indentation
returns to its loading curve without friction, the slip of the skin is path-dependent, not
the contact model.
"""

import logging
import math
import statistics
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from decks.contact_analysis import Contact, Model
from decks.dialects import JOB
from decks.finger import Finger
from fembridge.errors import ResponseError, ResultError, StimulusError
from fembridge.host.cache import entries
from fembridge.host.store import write_text
from fembridge.io.run_folder import RunFolder
from fembridge.response.response_map import (
    IN_PLANE,
    MAP_FILE,
    ResponseMap,
    write_map,
)
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import FrdIndex, values_at
from fembridge.results.printed import read_node_print
from fembridge.results.von_mises import clear_shear, von_mises_pa
from fembridge.solver.build import build_run_folder
from fembridge.solver.ccx import solve_once
from fembridge.solver.settings import DEFAULTS, Solver
from fembridge.solver.verdict import Cause, Outcome
from fembridge.stimulus import Stimulus
from fembridge.trace import MS_PER_S, PA_PER_MPA
from fembridge.typing import FloatArray

_LOGGER = logging.getLogger(__name__)

LADDER = (
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0),
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0, stick_share=0.01),
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0, friction=0.0),
    Contact("node-to-surface", stiffness_mpa_per_mm=50.0),
    Contact("surface-to-surface", stiffness_mpa_per_mm=1000.0),
    Contact("surface-to-surface", stiffness_mpa_per_mm=3000.0),
)

# Failures that another contact model may avoid. A missing solver, a full disk or an
# interrupt is no reason to try the next model.
CONTACT_CAUSES = frozenset(
    {Cause.DIVERGED, Cause.ENDLESS_ITERATION, Cause.STALLED, Cause.NEGATIVE_JACOBIAN}
)

ATTEMPTS_FILE = "contacts.txt"

CLOSURE_PERCENT = 0.5
DEFAULT_DEPTH_UM = 400.0
"""Deep enough for every stimulus of the catalogue: 250 um and the noise's peaks."""
STEPS = 30
"""Steps grow with depth, so that a small vibration spans as many steps as a large one."""
DEEP_UM = 1000.0
"""Depth of the indentation for all stimuli deeper than `DEFAULT_DEPTH_UM`."""
REACH_UM = 2000.0
"""Largest depth. Nothing deeper was ever solved: the reference fingers reach 1500 um."""

_PROBE_SET = "PROBE"
_GROWTH = 1.7
_UNLOAD_EVERY = 3
_DT_MS = 0.5
_DIGITS = 3
# Below this depth the first steps would round to the same depth.
_MIN_DEPTH_UM = 1.0
# Steps shallower than this share of the deepest are not compared: the first touch of
# a few nodes says nothing about a contact model.
_COMPARED_DEPTH_SHARE = 0.05
_MATCH_UM = 1.0e-6
# Smallest displacement of the skin under the probe, over the probe's depth.
_MIN_APEX_SHARE = 0.5
_UM_PER_MM = 1000.0
# Solvers print times with six digits.
_TIME_TOLERANCE = 1.0e-5
# An increment takes two iterations, each a factorisation. The time of a factorisation of a
# plane mesh grows with the number of elements to the power 1.15, as `fembridge verify`
# measured from 1 600 to 39 700 elements.
_REFERENCE_ELEMENTS, _REFERENCE_INCREMENT_S, _COST_POWER = 3100, 0.45, 1.15
_RECENT_RUNS = 20  # latest runs in the cache, used for the estimate
_MAX_COST = 1e15  # largest plausible seconds, increments or bytes of a cached run
_DECK_BYTES_PER_ELEMENT = 69.4
"""Bytes per element in decks of the reference fingers."""


class HysteresisError(ResponseError):
    """Unloading differs from loading by `closure_percent`, more than a map allows."""

    def __init__(self, problem: str = "", *, closure_percent: float = math.nan) -> None:
        super().__init__(problem)
        self.closure_percent = closure_percent


class FrictionSlipError(HysteresisError):
    """Unloading differs from loading by friction alone: without it the same contact returns.

    The contact model `contact` is valid, but the stress depends on the path of the probe:
    each waveform needs a transient run.
    """

    def __init__(
        self,
        problem: str = "",
        *,
        closure_percent: float = math.nan,
        contact: Contact = LADDER[0],
    ) -> None:
        super().__init__(problem, closure_percent=closure_percent)
        self.contact = contact


class Attempt(NamedTuple):
    """Contact model, probe support and number of loading steps of an indentation."""

    contact: Contact
    support: str
    steps: int = STEPS

    def __str__(self) -> str:
        steps = "" if self.steps == STEPS else f", {self.steps} steps"
        spring = ", probe on a spring" if self.support == "spring" else ""
        return f"{self.contact}{spring}{steps}"


def map_obstacle(finger: Finger, stimuli: Sequence[Stimulus], *, inertia: bool) -> str | None:
    """Reason why stress is no function of depth alone; None if it is one.

    Friction is not checked here: see `solve_response`.
    """
    relaxing = [layer for layer, material in finger.materials.items() if material.prony]
    if relaxing:
        verb = "relaxes" if len(relaxing) == 1 else "relax"
        return f"{', '.join(relaxing)} {verb}: stress depends on time, not on depth alone"
    if inertia:
        return "inertia counts: stress depends on acceleration, not on depth alone"
    sliding = [stimulus.id for stimulus in stimuli if stimulus.aside_um is not None]
    if sliding:
        return (
            f"{sliding[0]}: the probe slides across the skin: stress depends on its "
            "position, not on depth alone"
        )
    return None


def solve_response(
    folder: Path,
    model: Model,
    needed_um: float = DEFAULT_DEPTH_UM,
    settings: Solver = DEFAULTS,
    *,
    ladder: Sequence[Contact] = LADDER,
) -> tuple[Model, ResponseMap]:
    """`model` with the first accepted contact of the `ladder`, and its response map.

    The map is solved in `folder`, one run folder per contact model, and written there as
    ``response.toml``. Complete results of the same deck, in `folder` or in the cache, are
    reused.

    Parameters
    ----------
    folder
        Folder of the run folders and of the map.
    model
        Finger, mesh, probe and constitutive law. Where stress depends on time, the map has
        the instantaneous stress.
    needed_um
        Depth in um that the map must reach. Default: 400.
    settings
        How the solver is run.
    ladder
        Contact models in the order of trial. Default: `LADDER`.

    Raises
    ------
    SolverError
        A run failed for a reason that another contact model cannot avoid.
    FrictionSlipError
        A contact model is rejected because of friction alone: no map is valid for it.
    ResponseError
        No contact model was accepted; the reasons are in ``contacts.txt``.
    """
    depth_um, settings, static_model = depth_for(needed_um), settings.shared_by(1), model.at_once()
    is_forecast = False

    def solve_attempt(name: str, attempt: Attempt) -> tuple[Outcome, ResponseMap | ResponseError]:
        """Outcome of the run, with its response map or the reason of its rejection."""
        stimulus = indentation(depth_um, attempt.steps)
        variant = replace(static_model, support=attempt.support, contact=attempt.contact)
        run = build_run_folder(folder / name, variant, stimulus)

        def log_forecast() -> None:  # of the first run that the cache cannot answer
            nonlocal is_forecast
            if not is_forecast:
                is_forecast = True
                _log_forecast(variant, stimulus)

        outcome = solve_once(run, settings, on_start=log_forecast)
        if outcome.failure is not None:
            if outcome.failure.cause not in CONTACT_CAUSES:
                raise outcome.to_error()
            return outcome, ResponseError(str(outcome.failure))
        try:
            return outcome, measured_response(run, stimulus)
        except ResponseError as error:
            return outcome, error

    attempts = list_attempts(depth_um, ladder)
    rejections: list[str] = []
    for number, attempt in enumerate(attempts, start=1):
        if rejections:
            _LOGGER.info(f"contact model {number} of {len(attempts)}: {attempt}")
        outcome, response = solve_attempt(f"contact_{number}", attempt)
        if isinstance(response, ResponseMap):
            write_map(folder / MAP_FILE, response)
            source_text = "reused" if outcome.skipped else f"solved in {outcome.wall_s:.0f} s"
            source_text = "read from the cache" if outcome.cached else source_text
            _LOGGER.info(
                f"response of finger {model.finger.name!r} {source_text}: "
                f"{outcome.increments} increments, contact {attempt.contact}, unloading within "
                f"{response.closure_percent:.2g} % of loading"
            )
            return replace(model, contact=attempt.contact), response
        if isinstance(response, HysteresisError) and attempt.contact.friction > 0:
            frictionless = replace(attempt.contact, friction=0.0)
            _, frictionless_response = solve_attempt(
                f"frictionless_{number}", attempt._replace(contact=frictionless)
            )
            if isinstance(frictionless_response, ResponseMap):
                raise FrictionSlipError(
                    f"skin slips under the probe: with {attempt.contact}, unloading differs "
                    f"from loading by {response.closure_percent:.3g} % at the same depth, without "
                    f"friction by {frictionless_response.closure_percent:.2g} %, expected at most "
                    f"{CLOSURE_PERCENT} %: stress depends on the probe's path, not on depth "
                    "alone",
                    closure_percent=response.closure_percent,
                    contact=attempt.contact,
                )
        rejections.append(f"{attempt}: {response}")
        _LOGGER.info(f"rejected {rejections[-1]}")
    write_text(folder / ATTEMPTS_FILE, "\n".join(rejections) + "\n")
    raise ResponseError(
        f"none of {len(rejections)} contact models was accepted to {depth_um:g} um, reasons in "
        f"{ATTEMPTS_FILE}; choose a smaller amplitude, or --law neo-hookean",
        folder,
    )


def _log_forecast(model: Model, stimulus: Stimulus) -> None:
    """Log increments and expected duration of the indentation `stimulus`."""
    increments = stimulus.displacement_um.size - 1
    is_halved = model.support == "spring" and model.section == "half"
    elements = len(model.mesh.quad) * (0.5 if is_halved else 1.0)
    duration = format_duration(increments * increment_s(elements))
    _LOGGER.info(
        f"indentation to {stimulus.deepest_um:g} um: {increments} increments, about {duration}"
    )


def list_attempts(depth_um: float, ladder: Sequence[Contact]) -> list[Attempt]:
    """Attempts in the order of trial; beyond `DEEP_UM` only those with the first contact."""
    support = "prescribed" if depth_um <= DEFAULT_DEPTH_UM else "spring"
    first, *others = (Attempt(contact, support) for contact in ladder)
    spring = Attempt(first.contact, "spring")
    attempts = [first] if support == "spring" else [first, spring]
    attempts.append(spring._replace(steps=2 * STEPS))
    return attempts if depth_um > DEEP_UM else [*attempts, *others]


def increment_s(elements: float) -> float:
    """Estimated seconds per increment of a mesh of `elements`, from the latest runs here."""
    costs_s: list[float] = []
    for entry in entries(_RECENT_RUNS):
        costs = [entry.record.get(name) for name in ("wall_s", "increments", "deck_bytes")]
        if all(isinstance(cost, int | float) and 0 < cost < _MAX_COST for cost in costs):
            wall_s, increments, deck_bytes = map(float, costs)  # type: ignore[arg-type] # numbers
            costs_s.append(
                wall_s / increments / (deck_bytes / _DECK_BYTES_PER_ELEMENT) ** _COST_POWER
            )
    cost_s = (
        statistics.median(costs_s)
        if costs_s
        else _REFERENCE_INCREMENT_S / _REFERENCE_ELEMENTS**_COST_POWER
    )
    return float(cost_s * elements**_COST_POWER)


def format_duration(seconds: float) -> str:
    """Duration rounded to one or two figures: ``20 s``, ``4 min``, ``6 h``."""
    unit_s, unit = next(
        (scale for scale in ((3600.0, "h"), (60.0, "min")) if seconds >= 1.5 * scale[0]), (1.0, "s")
    )
    count = max(seconds, 1.0) / unit_s
    figures = 1 if unit == "s" and count < 10 else 2
    return f"{float(f'{count:.{figures}g}'):g} {unit}"


def indentation(depth_um: float = DEFAULT_DEPTH_UM, steps: int = STEPS) -> Stimulus:
    """Stimulus that loads to `depth_um` in `steps` and unloads over every third depth.

    The result does not depend on time; a step is one increment of the solver.
    """
    if not _MIN_DEPTH_UM <= depth_um <= REACH_UM:
        expected = f"{_MIN_DEPTH_UM:g} to {REACH_UM:g} um"
        raise StimulusError(
            f"indentation is {depth_um:g} um deep, expected {expected}; "
            "choose a smaller amplitude or pre-indentation",
            found=depth_um,
            expected=expected,
        )
    load_um = loading_um(depth_um, steps)
    unload_um = load_um[steps - _UNLOAD_EVERY : 0 : -_UNLOAD_EVERY]
    samples_um = np.concatenate([load_um, unload_um])
    return Stimulus(
        id=f"indentation_{depth_um:g}",
        displacement_um=samples_um,
        dt_ms=_DT_MS,
        window_ms=(0.0, (samples_um.size - 1) * _DT_MS),
        origin={"family": "indentation", "depth_um": float(depth_um)},
    )


def loading_um(depth_um: float, steps: int) -> FloatArray:
    """Depths in um from 0 to `depth_um` in growing steps, ``(steps + 1,)``."""
    load_um: FloatArray = np.round(depth_um * (np.arange(steps + 1) / steps) ** _GROWTH, _DIGITS)
    return load_um


def depth_for(needed_um: float) -> float:
    """Depth in um of the indentation for stimuli down to `needed_um`."""
    depths_um = (DEFAULT_DEPTH_UM, DEEP_UM, float(np.ceil(needed_um / 100.0) * 100.0))
    return next(depth_um for depth_um in depths_um if needed_um <= depth_um)


def judge(
    depth_um: FloatArray, stress_pa: FloatArray, force_n_per_mm: FloatArray, apex_um: FloatArray
) -> tuple[float, ResponseError | None]:
    """Closure in percent of a load-unload run, and the error that rejects it or None.

    `depth_um` ``(T,)`` is the probe's depth, the rest state first; `stress_pa`
    ``(T, afferent)`` von Mises stress; `force_n_per_mm` ``(T,)`` the force of the skin on
    the probe; `apex_um` ``(T,)`` the inward displacement of the skin's apex.

    The closure is the largest difference between unloading and loading at the same depth,
    in percent of the loading stress, over all afferents; NaN where nothing could be
    compared. A `HysteresisError` means that only the closure is too large.
    """
    deepest = int(depth_um.argmax())
    deepest_um, deepest_apex_um = float(depth_um[deepest]), float(apex_um[deepest])
    deepest_n_per_mm = float(force_n_per_mm[deepest])
    load_um, unload_um = depth_um[: deepest + 1], depth_um[deepest + 1 :]
    same_depth = np.abs(load_um - unload_um[:, None]) <= _MATCH_UM
    is_compared = same_depth.any(axis=1) & (unload_um >= _COMPARED_DEPTH_SHARE * deepest_um)
    closure_percent = math.nan
    if is_compared.any():
        loading_pa = stress_pa[same_depth[is_compared].argmax(axis=1)]
        with np.errstate(divide="ignore", invalid="ignore"):
            difference = np.abs(stress_pa[deepest + 1 :][is_compared] / loading_pa - 1)
        closure_percent = 100 * float(difference.max())
    problem = ""
    if not (deepest_n_per_mm > 0 and deepest_apex_um >= _MIN_APEX_SHARE * deepest_um):
        problem = (
            f"the probe did not push: at {deepest_um:g} um the skin moved "
            f"{deepest_apex_um:.3g} um, the force is {deepest_n_per_mm:.3g} N/mm"
        )
    elif not (stress_pa[deepest] > 0).all():
        problem = f"the stress at an afferent is 0 at {deepest_um:g} um"
    elif not closure_percent <= CLOSURE_PERCENT:  # NaN is rejected too
        message = f"unloading differs from loading by {closure_percent:.3g} % at the same depth"
        return closure_percent, HysteresisError(
            f"{message}, expected at most {CLOSURE_PERCENT} %", closure_percent=closure_percent
        )
    return closure_percent, ResponseError(problem) if problem else None


def measured_response(run: RunFolder, stimulus: Stimulus) -> ResponseMap:
    """Response map from the results of the indentation `stimulus`.

    Raises
    ------
    ResultError
        See `read_pressed`.
    HysteresisError, ResponseError
        The contact model is rejected: see `judge`.
    """
    nodes = [site.node for site in run.afferents]
    pressed = read_pressed(run, stimulus, [*nodes, run.apex_node])
    depth_um, tensor_pa = stimulus.displacement_um, pressed.tensor_pa[:, :-1]
    tensor_pa[..., IN_PLANE:] = 0.0  # plane strain: rounding noise
    apex_um = -_UM_PER_MM * pressed.moved_mm[:, -1, 1]
    closure_percent, refusal = judge(
        depth_um, von_mises_pa(tensor_pa), pressed.force_n_per_mm, apex_um
    )
    if refusal is not None:
        raise refusal
    loading = slice(0, int(depth_um.argmax()) + 1)
    return ResponseMap(
        depth_um=depth_um[loading],
        tensor_pa=tensor_pa[loading],
        force_n_per_mm=pressed.force_n_per_mm[loading],
        places=run.afferents,
        closure_percent=round(closure_percent, 6),
        origin={"solver": run.solver, "deck_sha256": run.deck_sha256, **run.inputs},
    )


class Pressed(NamedTuple):
    """Stress ``(T, node, 6)`` in Pa, displacement ``(T, node, 3)`` and force ``(T,)`` of the skin.

    Sample 0 is the rest state.
    """

    tensor_pa: FloatArray
    moved_mm: FloatArray
    force_n_per_mm: FloatArray


def read_pressed(run: RunFolder, stimulus: Stimulus, nodes: Sequence[int]) -> Pressed:
    """Stress and displacement at `nodes`, and the force of the skin on the probe.

    The first sample of the `stimulus` is the rest state, which no solver writes. The run was
    accepted, so its results are complete; fembridge wrote the deck, so units, materials and
    relaxation need no checks as in `fembridge.results.read`.

    Raises
    ------
    ResultError
        The results are at other times than the waveform (as in a run with a ramp to a
        pre-indentation), or not finite.
    """
    fields = []
    with ByteFile(run.results) as file:
        index = FrdIndex(file)
        for name in ("STRESS", "DISP"):
            blocks = index.named(name)
            check_times_match(np.array([block.time_ms for block in blocks]), stimulus, run.results)
            fields.append(values_at(file, blocks, nodes))
    tensor_mpa, moved_mm = fields
    clear_shear(tensor_mpa, nodes, run.on_axis)
    printed = run.folder / f"{JOB}.dat"
    force_ms, _, total_n = read_node_print(printed, "total force", _PROBE_SET)
    check_times_match(force_ms, stimulus, printed)
    force_n = total_n[:, 0, 1]
    if not all(np.isfinite(array).all() for array in (tensor_mpa, moved_mm, force_n)):
        raise ResultError("stress, displacement or force is not finite", run.results)
    # `RF` is the force that pushes the probe down; the section is 1 mm thick.
    solved = [PA_PER_MPA * tensor_mpa, moved_mm, -force_n]
    # The rest state, which no solver writes, is put in front.
    return Pressed(*(np.concatenate([np.zeros_like(array[:1]), array]) for array in solved))


def check_times_match(times_ms: FloatArray, stimulus: Stimulus, path: Path) -> None:
    """Raise ResultError where results are not at the times of the `stimulus` after rest."""
    expected_ms = stimulus.times_ms[1:]
    if times_ms.size != expected_ms.size:
        raise ResultError(f"{times_ms.size} increments, expected {expected_ms.size}", path)
    differs = np.abs(times_ms - expected_ms) > _TIME_TOLERANCE * expected_ms[-1]
    if differs.any():
        row = int(differs.argmax())
        raise ResultError(
            f"increment {row + 1} is at {times_ms[row] / MS_PER_S:g} s, expected "
            f"{expected_ms[row] / MS_PER_S:g} s",
            path,
        )
