"""The indentation that a response map is made of: solved, and accepted or not.

The probe goes down in steps and comes back: unloading has to find loading's stress.
Two traps, both measured with ccx 2.20. Surface-to-surface contact is path-dependent:
on the way back the stress at a depth came out 17 to 20 % low. And a thin probe slips
between the skin's nodes: the run ends well, the skin untouched.

To 400 um each of the probe's nodes is prescribed, so all that was measured of contacts
was measured; deeper it hangs on a stiff spring (see ``decks/calculix.inp.j2``): prescribed, ccx
loses all contact on the way back. With a spring the linear law reaches 1.5 mm, and at
every depth to 400 um the stress is that of the prescribed probe within 0.01 %.

The ladder of contact models is tried from the top; its first also on a spring and in
smaller steps. Node-to-surface with friction came back to its loading curve in every run to
400 um and takes two iterations an increment; what follows is for meshes on which it does
not converge, in the order of what it changes: softer stick springs, then no friction (0.3 %
of stress at most), softer springs (2 %), and last surface-to-surface contact. A contact
model that runs but does not come back is not taken.

A map is one indentation, read at the depth of each sample, so time and place must not
matter: no layer relaxes, no mass is accelerated, the probe does not slide. That is
known before anything is solved. Friction is not: skin that slips under the probe on
its way in does not slip back on the same way out. Where the indentation comes back
without friction, it is not the contact that is path-dependent but the skin that slips.
"""

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from decks.analysis import Contact, Model
from decks.dialects import JOB
from fembridge.build import build_run_folder
from fembridge.cache import entries
from fembridge.errors import ResponseError, ResultError, StimulusError
from fembridge.response.response_map import IN_PLANE, MAP_FILE, ResponseMap, write_map
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd import FrdIndex, values_at
from fembridge.results.printed import read_node_print
from fembridge.results.stress import clear_shear, von_mises_pa
from fembridge.run_folder import RunFolder
from fembridge.solver.ccx import solve_once
from fembridge.solver.settings import DEFAULTS, SolverSettings
from fembridge.solver.verdict import Cause, Outcome
from fembridge.stimulus import Stimulus
from fembridge.store import write_text
from fembridge.trace import MS_PER_S, PA_PER_MPA
from fembridge.typing import FloatArray

LADDER = (
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0),
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0, stick_share=0.01),
    Contact("node-to-surface", stiffness_mpa_per_mm=200.0, friction=0.0),
    Contact("node-to-surface", stiffness_mpa_per_mm=50.0),
    Contact("surface-to-surface", stiffness_mpa_per_mm=1000.0),
    Contact("surface-to-surface", stiffness_mpa_per_mm=3000.0),
)

# Ends of a run that another contact model may avoid. A missing solver, a full
# disk or an interrupt are no reason to try the next.
CONTACT_CAUSES = frozenset(
    {Cause.DIVERGED, Cause.ENDLESS_ITERATION, Cause.STALLED, Cause.NEGATIVE_JACOBIAN}
)

ATTEMPTS_FILE = "contacts.txt"
RESPONSE_FOLDER = "response"

CLOSURE_PERCENT = 0.5
DEFAULT_DEPTH_UM = 400.0
"""Deep enough for every stimulus of the catalogue: 250 um and the noise's peaks."""
STEPS = 30
"""Steps grow with depth: a small vibration sees as many of them as a large one."""
DEEP_UM = 1000.0
"""Of all deeper stimuli: one indentation answers them too."""
REACH_UM = 2000.0
"""Nothing deeper was ever solved: the reference fingers reach 1500 um."""

_PROBE_SET = "PROBE"
_GROWTH = 1.7
_UNLOAD_EVERY = 3
_DT_MS = 0.5
_DIGITS = 3
# Shallower, the first steps would round to the same depth.
_LEAST_UM = 1.0
# Shallower than this share of the deepest, a step is not compared: the first
# touch of a few nodes is no measure of a contact model.
_COMPARED_SHARE = 0.05
_MATCH_UM = 1.0e-6
# The skin under the probe follows it, less what the penalty springs give.
_FOLLOWED_SHARE = 0.5
_UM_PER_MM = 1000.0
# Solvers print times with six digits.
_TIME_TOLERANCE = 1.0e-5
# An increment costs two iterations, each a factorisation: of a plane mesh about the 1.15th
# power of its elements, as `fembridge verify` measured from 1 600 to 39 700 of them.
_ELEMENTS, _INCREMENT_S, _POWER = 3100, 0.45, 1.15
_RUNS_SEEN = 20  # the last of the cache, of which an estimate is made
_MOST_COST = 1e15  # of a record in seconds, increments or bytes: beyond it no run was
_DECK_BYTES = 69.4
"""Of a deck of the reference fingers, an element."""

Log = Callable[[str], None]
"""Called with each line about what goes on."""


class HysteresisError(ResponseError):
    """Unloading differs from loading by `closure_percent`, too much for a map."""

    def __init__(self, problem: str, closure_percent: float, *more: object) -> None:
        super().__init__(problem, closure_percent, *more)  # these rebuild it after pickling
        self.closure_percent = closure_percent

    def __str__(self) -> str:
        return str(self.args[0])


class FrictionSlipError(HysteresisError):
    """Friction is what unloading differs by: without it the same contact comes back.

    The contact model `contact` is sound; the stress of a waveform takes the whole way
    of the probe, a transient.
    """

    def __init__(self, problem: str, closure_percent: float, contact: Contact) -> None:
        super().__init__(problem, closure_percent, contact)
        self.contact = contact


class Attempt(NamedTuple):
    """One way to solve the indentation."""

    contact: Contact
    support: str
    steps: int = STEPS

    def __str__(self) -> str:
        steps = "" if self.steps == STEPS else f", {self.steps} steps"
        spring = ", probe on a spring" if self.support == "spring" else ""
        return f"{self.contact}{spring}{steps}"


def why_no_map(model: Model, stimuli: Sequence[Stimulus]) -> str | None:
    """Why stress is no function of depth alone; None: nothing is known.

    Friction is not judged here: see `solve_response`.
    """
    relaxing = [layer for layer, one in model.finger.materials.items() if one.prony]
    if relaxing:
        verb = "relaxes" if len(relaxing) == 1 else "relax"
        return f"{', '.join(relaxing)} {verb}: stress depends on time, not on depth alone"
    if model.inertia:
        return "inertia counts: stress depends on acceleration, not on depth alone"
    sliding = [stimulus.id for stimulus in stimuli if stimulus.aside_um is not None]
    if sliding:
        return (
            f"{sliding[0]}: the probe slides across the skin: stress depends on its "
            "place, not on depth alone"
        )
    return None


def solve_response(
    folder: Path,
    model: Model,
    needed_um: float = DEFAULT_DEPTH_UM,
    settings: SolverSettings = DEFAULTS,
    *,
    ladder: Sequence[Contact] = LADDER,
    log: Log = lambda line: None,
) -> tuple[Model, ResponseMap]:
    """`model` with the first contact of the `ladder` that is accepted, and its response.

    The response answers stimuli down to `needed_um`; of a model whose stress depends on
    time it is the one that it has at once. It is solved in `folder`, one run folder a
    contact model. One that was solved before, with the same deck, there or as the cache
    has it, is read again as long as its files are whole. The accepted map is written as
    ``response.toml``.

    Raises
    ------
    SolverError
        A run ended for a reason that another contact model does not cure.
    FrictionSlipError
        One is not accepted for the friction alone: no map holds for it.
    ResponseError
        None was accepted: each with its reason.
    """
    depth_um, settings, still = depth_for(needed_um), settings.shared_by(1), model.at_once()

    def solved(name: str, attempt: Attempt) -> tuple[Outcome, ResponseMap | ResponseError]:
        """The response that was accepted, or why the attempt is left."""
        stimulus = indentation(depth_um, attempt.steps)
        moved = replace(still, support=attempt.support, contact=attempt.contact)
        run = build_run_folder(folder / name, moved, stimulus)
        outcome = solve_once(run, settings)
        if outcome.failure is not None:
            if outcome.failure.cause not in CONTACT_CAUSES:
                raise outcome.to_error()
            return outcome, ResponseError(str(outcome.failure))
        try:
            return outcome, measured_response(run, stimulus)
        except ResponseError as error:
            return outcome, error

    attempts = attempts_for(depth_um, ladder)
    increments = indentation(depth_um).displacement_um.size - 1
    half = attempts[0].support == "spring" and still.section == "half"
    elements = len(model.mesh.quad) * (0.5 if half else 1.0)
    about = in_words(increments * increment_s(elements))
    log(f"indentation to {depth_um:g} um: {increments} increments, about {about}")
    left: list[str] = []
    for number, attempt in enumerate(attempts, start=1):
        if left:
            log(f"contact model {number} of {len(attempts)}: {attempt}")
        outcome, found = solved(f"contact_{number}", attempt)
        if isinstance(found, ResponseMap):
            write_map(folder / MAP_FILE, found)
            how = "read again" if outcome.skipped else f"solved in {outcome.wall_s:.0f} s"
            how = "taken from the cache" if outcome.cached else how
            log(
                f"response of finger {model.finger.name!r} {how}: "
                f"{outcome.increments} increments, contact {attempt.contact}, unloading within "
                f"{found.closure_percent:.2g} % of loading"
            )
            return replace(model, contact=attempt.contact), found
        if isinstance(found, HysteresisError) and attempt.contact.friction > 0:
            without = replace(attempt.contact, friction=0.0)
            _, smooth = solved(f"frictionless_{number}", attempt._replace(contact=without))
            if isinstance(smooth, ResponseMap):
                raise FrictionSlipError(
                    f"skin slips under the probe: with {attempt.contact}, unloading differs "
                    f"from loading by {found.closure_percent:.3g} % at the same depth, without "
                    f"friction by {smooth.closure_percent:.2g} %, expected at most "
                    f"{CLOSURE_PERCENT} %: stress depends on the probe's way, not on depth "
                    "alone",
                    found.closure_percent,
                    attempt.contact,
                )
        left.append(f"{attempt}: {found}")
        log(f"left {left[-1]}")
    write_text(folder / ATTEMPTS_FILE, "\n".join(left) + "\n")
    raise ResponseError(
        f"{folder}: none of {len(left)} contact models was accepted to {depth_um:g} um, each "
        f"with its reason in {ATTEMPTS_FILE}; take a smaller amplitude, or --law neo-hookean"
    )


def attempts_for(depth_um: float, ladder: Sequence[Contact]) -> list[Attempt]:
    """What is tried in turn; no contact model is a cure for more than `DEEP_UM`."""
    support = "prescribed" if depth_um <= DEFAULT_DEPTH_UM else "spring"
    first, *others = (Attempt(contact, support) for contact in ladder)
    spring = Attempt(first.contact, "spring")
    firsts = [first] if support == "spring" else [first, spring]
    firsts.append(spring._replace(steps=2 * STEPS))
    return firsts if depth_um > DEEP_UM else [*firsts, *others]


def increment_s(elements: float) -> float:
    """Seconds of an increment of a mesh of so many `elements`, as the last runs here took."""
    shares: list[float] = []
    for entry in entries(_RUNS_SEEN):
        costs = [entry.record.get(name) for name in ("wall_s", "increments", "deck_bytes")]
        if all(isinstance(cost, int | float) and 0 < cost < _MOST_COST for cost in costs):
            wall_s, increments, deck_bytes = map(float, costs)  # type: ignore[arg-type] # numbers
            shares.append(wall_s / increments / (deck_bytes / _DECK_BYTES) ** _POWER)
    share = statistics.median(shares) if shares else _INCREMENT_S / _ELEMENTS**_POWER
    return float(share * elements**_POWER)


def in_words(seconds: float) -> str:
    """A time of which the first figure may be right: ``20 s``, ``4 min``, ``6 h``."""
    size, unit = next(
        (each for each in ((3600.0, "h"), (60.0, "min")) if seconds >= 1.5 * each[0]), (1.0, "s")
    )
    count = max(seconds, 1.0) / size
    figures = 1 if unit == "s" and count < 10 else 2
    return f"{float(f'{count:.{figures}g}'):g} {unit}"


def indentation(depth_um: float = DEFAULT_DEPTH_UM, steps: int = STEPS) -> Stimulus:
    """Load to `depth_um` in `steps`, unload over every third of their depths.

    Time has no meaning here; a step is one increment of the solver.
    """
    if not _LEAST_UM <= depth_um <= REACH_UM:
        raise StimulusError(
            f"{depth_um:g} um deep, expected {_LEAST_UM:g} to {REACH_UM:g} um: no deeper "
            "indentation was ever solved; take a smaller amplitude or pre-indentation"
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
    """Depths from 0 to `depth_um` in `steps` that grow, ``(steps + 1,)``."""
    load_um: FloatArray = np.round(depth_um * (np.arange(steps + 1) / steps) ** _GROWTH, _DIGITS)
    return load_um


def depth_for(needed_um: float) -> float:
    """Depth of the indentation that answers stimuli down to `needed_um`."""
    depths_um = (DEFAULT_DEPTH_UM, DEEP_UM, float(np.ceil(needed_um / 100.0) * 100.0))
    return next(depth_um for depth_um in depths_um if needed_um <= depth_um)


def judge(
    depth_um: FloatArray, stress_pa: FloatArray, force_n_per_mm: FloatArray, apex_um: FloatArray
) -> tuple[float, ResponseError | None]:
    """Closure of a run that loads to its deepest sample and comes back; why it is not accepted.

    `depth_um` ``(T,)`` is the probe's, the rest state first; `stress_pa` ``(T, afferent)``
    is von Mises stress; then the force of the skin on the probe, and how far the skin's
    apex moved in, ``(T,)``.

    The closure is the largest difference between unloading and loading at the same depth,
    in percent of the loading stress there, over all afferents; NaN where nothing could be
    compared. Where it alone is too large that is a `HysteresisError`.
    """
    deepest = int(depth_um.argmax())
    deepest_um, moved_um = float(depth_um[deepest]), float(apex_um[deepest])
    force = float(force_n_per_mm[deepest])
    load_um, back_um = depth_um[: deepest + 1], depth_um[deepest + 1 :]
    same = np.abs(load_um - back_um[:, None]) <= _MATCH_UM
    compared = same.any(axis=1) & (back_um >= _COMPARED_SHARE * deepest_um)
    closure = math.nan
    if compared.any():
        loading_pa = stress_pa[same[compared].argmax(axis=1)]
        with np.errstate(divide="ignore", invalid="ignore"):
            off = np.abs(stress_pa[deepest + 1 :][compared] / loading_pa - 1)
        closure = 100 * float(off.max())
    problem = ""
    if not (force > 0 and moved_um >= _FOLLOWED_SHARE * deepest_um):
        problem = (
            f"the probe did not push: at {deepest_um:g} um the skin moved "
            f"{moved_um:.3g} um, the force is {force:.3g} N/mm"
        )
    elif not (stress_pa[deepest] > 0).all():
        problem = f"an afferent feels nothing: its stress at {deepest_um:g} um is 0"
    elif not closure <= CLOSURE_PERCENT:  # nor where there is none
        words = f"unloading differs from loading by {closure:.3g} % at the same depth"
        return closure, HysteresisError(f"{words}, expected at most {CLOSURE_PERCENT} %", closure)
    return closure, ResponseError(problem) if problem else None


def measured_response(run: RunFolder, stimulus: Stimulus) -> ResponseMap:
    """Read the results of the indentation `stimulus` and accept it, or say why not.

    Raises
    ------
    ResultError
        As of `read_pressed`.
    HysteresisError, ResponseError
        The contact model is not to be trusted: see `judge`.
    """
    nodes = [place.node for place in run.afferents]
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
    """What the skin did on a probe's way ``(T, node, ...)``, ``(T,)``, the rest state first."""

    tensor_pa: FloatArray
    moved_mm: FloatArray
    force_n_per_mm: FloatArray


def read_pressed(run: RunFolder, stimulus: Stimulus, nodes: Sequence[int]) -> Pressed:
    """Stress and displacement at `nodes`, and the force of the skin on the probe.

    The first sample of the `stimulus` is the rest state, which no solver writes. The run was
    accepted, so its results are whole; the deck is ours, so there is no unit, material or
    relaxing skin to ask for, as `fembridge.results.read` does.

    Raises
    ------
    ResultError
        The results are at other times than the waveform, those of a run with a ramp to a
        pre-indentation, for example, or not finite.
    """
    found = []
    with ByteFile(run.results) as file:
        index = FrdIndex(file)
        for name in ("STRESS", "DISP"):
            blocks = index.named(name)
            check_times(np.array([one.time_ms for one in blocks]), stimulus, run.results)
            found.append(values_at(file, blocks, nodes))
    tensor_mpa, moved_mm = found
    clear_shear(tensor_mpa, nodes, run.on_axis)
    printed = run.folder / f"{JOB}.dat"
    force_ms, _, total_n = read_node_print(printed, "total force", _PROBE_SET)
    check_times(force_ms, stimulus, printed)
    force_n = total_n[:, 0, 1]
    if not all(np.isfinite(one).all() for one in (tensor_mpa, moved_mm, force_n)):
        raise ResultError("stress, displacement or force is not finite", run.results)
    # `RF` is the force that pushes the probe down; the section is 1 mm thick.
    found = [PA_PER_MPA * tensor_mpa, moved_mm, -force_n]
    # The rest state in front, which no solver writes.
    return Pressed(*(np.concatenate([np.zeros_like(one[:1]), one]) for one in found))


def check_times(found_ms: FloatArray, stimulus: Stimulus, path: Path) -> None:
    """Refuse results at other times than those of the `stimulus` behind the rest state."""
    expected_ms = stimulus.times_ms[1:]
    if found_ms.size != expected_ms.size:
        raise ResultError(f"{found_ms.size} increments, expected {expected_ms.size}", path)
    off = np.abs(found_ms - expected_ms) > _TIME_TOLERANCE * expected_ms[-1]
    if off.any():
        row = int(off.argmax())
        raise ResultError(
            f"increment {row + 1} is at {found_ms[row] / MS_PER_S:g} s, expected "
            f"{expected_ms[row] / MS_PER_S:g} s",
            path,
        )
