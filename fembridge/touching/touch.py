"""A touch: a shape, its trajectory, and the spikes of the afferents of a fingertip.

Contact is solved along the trajectory, stress is superposed from the forces, and all units
fire in one pass.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from fembridge.errors import UsageError, warn
from fembridge.ranges import Range, check_range
from fembridge.solver.mechanics import report_mechanics
from fembridge.touching.contact import MOST_UM
from fembridge.touching.contact_history import ContactHistory, contact_warnings, solve_contact
from fembridge.touching.fingerprint import Fingerprint
from fembridge.touching.pad import Pad
from fembridge.touching.pad_file import resolve_pad
from fembridge.touching.population import Population, check_inside, resolve_population
from fembridge.touching.prism_pad import PrismPad
from fembridge.touching.relaxation import prony_table, relaxation_of, relaxing_pad
from fembridge.touching.ridged_pad import RidgedPad, with_ridges
from fembridge.touching.shape import Shape, resolve_shape
from fembridge.touching.stress import ContactStress, interpolate_states
from fembridge.touching.touch_result import Touch
from fembridge.touching.trajectory import Trajectory
from fembridge.version import __version__
from neural.encoder import encode_units
from neural.parameter_sets import ParameterSet, parameter_set

if TYPE_CHECKING:
    import os

    import pandas

    from decks.finger import Finger
    from fembridge.io.waveform import WaveformLike
    from fembridge.typing import Table

# Friction of skin on the shape (Ishizuka et al., 3.1).
FRICTION = 0.4
PAD, SHAPE = "reference", "punch"
"""Default pad and shape."""


def touch(
    shape: str | Shape = SHAPE,
    trajectory: Trajectory | None = None,
    *,
    stimulus: WaveformLike | None = None,
    press_um: float | None = None,
    press_n: float | None = None,
    population: str | os.PathLike[str] | pandas.DataFrame | Population = "fingertip",
    pad: str | Path | Pad = PAD,
    finger: str | Path | Finger | None = None,
    ridges: str | Fingerprint | None = None,
    parameters: str | Path | ParameterSet | None = None,
    at_mm: tuple[float, float] = (0.0, 0.0),
    angle_deg: float = 0.0,
    tilt_deg: tuple[float, float] = (0.0, 0.0),
    friction: float | None = None,
    preindent_um: float | None = None,
    trials: int = 1,
    noise_mv: float = 0.0,
    seed: int = 0,
) -> Touch:
    """Press, vibrate or slide a shape on a whole fingertip: the spikes of every afferent.

    Parameters
    ----------
    shape
        A `Shape`, or a specification such as ``"bar:width_mm=1"`` of ``punch``, ``sphere``,
        ``cylinder``, ``plate``, ``bar``, ``edge``, ``grating``, ``dots``, ``braille`` or
        ``letters``. Heights of your own: ``Shape.from_heights(array, pixel_mm)`` or
        ``Shape.read(file, pixel_mm)``. Default: ``"punch"``, a flat pin of 1 mm.
    trajectory
        Depth or force of the shape, and its position, over time. Default: None, one of
        `stimulus`, `press_um` and `press_n` is given.
    stimulus
        Waveform of the depth of the shape: an id of the catalogue, a `Stimulus`, a
        `Waveform`, the path of a file, or a DataFrame. Default: None.
    press_um, press_n
        Depth in um, or force in N, of a press of 500 ms with ramps of 50 ms. Default: None.
    population
        A `Population`; a specification of ``fingertip``, ``grid``, ``line`` or ``one_each``,
        such as ``"fingertip:seed=3"``; or a DataFrame or the path of a table
        ``afferent,x_mm,z_mm``. Default: ``"fingertip"``, 888 units.
    pad
        ``"reference"``; ``"macaque"`` (a narrow finger); ``"plane"`` (the ridged section, endless
        along z); a round fingertip, ``"fingertip"`` or ``"fingertip_macaque"``; the path of a
        file, or a `Pad`. Default: ``"reference"``.
    finger
        Finger whose Prony terms the pad relaxes by: a TOML file or a `Finger`, with the sizes and
        instantaneous moduli of the pad's. Default: None, the finger of the pad.
    ridges
        Fingerprint ridges on the skin, on which contact is solved on a finer grid: ``"loop"``,
        ``"whorl"``, ``"across"``, ``"along"``, with sizes as in ``"whorl:period_mm=0.5,seed=3"``,
        or a `Fingerprint`; ``"none"``: smooth skin on the nodes of the pad. Default: None,
        ``"loop"`` on the pad of a smooth finger, ``"none"`` on others.
    parameters
        Neural parameters: the name of a set, the path of a TOML file, or a `ParameterSet`.
        Default: None, ``"fitted_pad"``, on a plane pad ``"fitted"``.
    at_mm
        Position of the shape in mm across and along the finger. Default: ``(0, 0)``.
    angle_deg
        Rotation of the shape in deg, counter-clockwise. Default: 0.
    tilt_deg
        Direction from which the shape comes, in deg from above: positive from the right, and
        from the tip. The middle of the shape then aims at the skin at `at_mm`, and the shape
        slides in its own plane. For pads of meshes. Default: ``(0, 0)``.
    friction
        Coefficient of friction of a shape that slides, 0 to 10. Default: None, 0.4.
    preindent_um
        Depth in um before time 0 of a waveform or of pins that begin at 0. Default: None, the
        depth at which `parameters` were fitted.
    trials
        Number of trials, 1 to 10000. Default: 1.
    noise_mv
        Noise of the membrane in mV after 1 ms, by which trials differ, 0 to 1000. Default: 0.
    seed
        Seed of the noise, a whole number >= 0. Default: 0.

    Returns
    -------
    Touch
        ``rates``, ``spikes`` and ``samples`` (depth and force) are DataFrames; ``plot()`` draws
        the pad from above, ``write(folder)`` the files of ``fembridge touch``.

    Raises
    ------
    UsageError, StimulusError, TableError
        An unknown name, a number out of range, an argument that this touch does not use, or a
        shape beside the pad.
    ResponseError
        A pad that was altered.

    Warns
    -----
    FembridgeWarning
        Contact reaches the end of the modelled skin, the shape is finer than the nodes resolve,
        it is more than 1 mm deep, or the parameters were fitted on other mechanics.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.touch("punch:diameter_mm=1", press_um=200, population="one_each")
    >>> result.rates["afferent"].tolist()
    ['SA', 'RA', 'PC']
    >>> slide = fb.Trajectory.slide(80, press_n=0.3, duration_ms=100)
    >>> fb.touch("grating", slide, population="line").trajectory.name
    'slide 80 mm/s 0.3 N'
    """
    inputs = resolve_touch(
        shape,
        trajectory,
        stimulus=stimulus,
        press_um=press_um,
        press_n=press_n,
        population=population,
        pad=pad,
        finger=finger,
        ridges=ridges,
        parameters=parameters,
        at_mm=at_mm,
        angle_deg=angle_deg,
        tilt_deg=tilt_deg,
        friction=friction,
        preindent_um=preindent_um,
    )
    return touch_skin(
        inputs.pad,
        inputs.shape,
        inputs.trajectory,
        inputs.population,
        inputs.parameters,
        friction=inputs.friction,
        trials=trials,
        noise_mv=noise_mv,
        seed=seed,
    )


class TouchInputs(NamedTuple):
    """The arguments of a touch, resolved: all but trials, noise and its seed.

    `shape` is at its place; None for the pins of `trajectory`.
    """

    pad: Pad
    shape: Shape | None
    trajectory: Trajectory
    population: Population
    parameters: ParameterSet
    friction: float


def resolve_touch(
    shape: str | Shape = SHAPE,
    trajectory: Trajectory | None = None,
    *,
    stimulus: WaveformLike | None = None,
    press_um: float | None = None,
    press_n: float | None = None,
    population: str | os.PathLike[str] | pandas.DataFrame | Population = "fingertip",
    pad: str | Path | Pad = PAD,
    finger: str | Path | Finger | None = None,
    ridges: str | Fingerprint | None = None,
    parameters: str | Path | ParameterSet | None = None,
    at_mm: tuple[float, float] = (0.0, 0.0),
    angle_deg: float = 0.0,
    tilt_deg: tuple[float, float] = (0.0, 0.0),
    friction: float | None = None,
    preindent_um: float | None = None,
) -> TouchInputs:
    """Pad, shape at its place, trajectory, population and parameters of a touch.

    Arguments, errors and warnings are those of `touch`.
    """
    skin = resolve_pad(pad)
    if finger is not None:
        skin = relaxing_pad(skin, finger)
    skin = with_ridges(skin, ridges)
    selected = parameters_on(skin, parameters)
    units = resolve_population(population, skin)
    depth_um = selected.preindent_um if preindent_um is None else preindent_um
    check_range("preindent_um", depth_um, Range(0, MOST_UM))
    path = _resolve_trajectory(trajectory, stimulus, press_um, press_n, depth_um)
    if preindent_um is not None and path.preindent_um != preindent_um:
        problem = (
            "is for a waveform or pins"
            if path.preindent_um is None
            else f"is {preindent_um:g}, but {path.name} begins at its own depth, "
            f"{path.preindent_um:g} um: omit it"
        )
        raise UsageError(problem, argument="preindent_um", found=preindent_um)
    if friction is not None and not path.slides:
        raise UsageError("is for a shape that slides", argument="friction", found=friction)
    body = None
    if path.pins is None:
        check_range("at_mm", at_mm[0])
        check_range("at_mm", at_mm[1])
        body = resolve_shape(shape).rotated(angle_deg)
        if tuple(tilt_deg) == (0.0, 0.0):
            body = body.moved(*at_mm)
        else:
            for angle in tilt_deg:
                check_range("tilt_deg", angle)
            skin = skin.seen_from((tilt_deg[0], tilt_deg[1]), at_mm)
    elif shape != SHAPE:
        raise UsageError("cannot be combined with pins", argument="shape", found=shape)
    elif at_mm != (0.0, 0.0) or angle_deg or tuple(tilt_deg) != (0.0, 0.0):
        argument = "angle_deg" if angle_deg else "tilt_deg" if any(tilt_deg) else "at_mm"
        raise UsageError("is for a shape, not for pins", argument=argument)
    depths_um = None if path.preindent_um is None else {path.preindent_um}
    report_mechanics(selected, skin.mechanics, depths_um)
    return TouchInputs(
        skin, body, path, units, selected, FRICTION if friction is None else friction
    )


def touch_skin(
    pad: Pad,
    shape: Shape | None,
    trajectory: Trajectory,
    population: Population,
    parameters: ParameterSet,
    *,
    friction: float = FRICTION,
    trials: int = 1,
    noise_mv: float = 0.0,
    seed: int = 0,
    contact: ContactHistory | None = None,
) -> Touch:
    """Touch a pad by a `shape` at its place, or by the pins of `trajectory`.

    The arguments are those of `touch`, resolved; `contact` is that of an earlier touch with the
    same pad, shape, trajectory and friction, which is then not solved again.

    Raises
    ------
    UsageError
        A shape beside the pad, too deep, or with too many nodes in contact; a unit for which
        the pad has no stress.
    ParameterError
        Parameters of another time step or another quantity.

    Warns
    -----
    FembridgeWarning
        See `fembridge.touching.contact_warnings`; the warnings are part of the provenance.
    """
    for argument, value in (
        ("friction", friction),
        ("trials", trials),
        ("noise_mv", noise_mv),
        ("seed", seed),
    ):
        check_range(argument, value)
    check_inside(pad, population)
    if contact is None:
        contact = solve_contact(pad, shape, trajectory, friction)
    fired = encode_units(
        ContactStress(pad, population, contact),
        list(population.afferent),
        trajectory.dt_ms,
        parameters.parameters,
        population.deviate,
        sign=population.sign,
        trials=trials,
        noise_mv=noise_mv,
        rng=np.random.default_rng(seed),
    )
    force_n, depth_um = (
        interpolate_states(contact.knots, values, contact.position)
        for values in (contact.total_n, contact.depth_um)
    )
    texts = contact_warnings(pad, shape, trajectory, contact, float(depth_um.max()))
    for text in texts:
        warn(text)
    origin: Table = {
        "fembridge": __version__,
        "pad": {"source": pad.source, "sha256": pad.sha256, **pad.origin},
        "finger": pad.mechanics,
        **{key: value for key, value in parameters.to_record().items() if value is not None},
        "friction": float(friction),
        "trials": int(trials),
        "noise_mv": float(noise_mv),
        "seed": int(seed),
        "nodes_in_contact": int(contact.forces_n[: contact.reached].any(axis=0).sum()),
        "warnings": texts,
    }
    if (relaxation := relaxation_of(pad)) and isinstance(pad, PrismPad):
        origin["relaxation"] = {**relaxation.to_table(), "prony": prony_table(pad.finger)}
    if shape is not None:
        origin["shape"] = shape.to_table()
    if isinstance(pad, RidgedPad):
        origin["ridges"] = pad.fingerprint.to_table()
    if pad.pose:
        origin["pose"] = pad.pose
    return Touch(
        population=population,
        trajectory=trajectory,
        force_n=force_n,
        depth_um=depth_um,
        contact=contact,
        fired=fired,
        trials=trials,
        origin=origin,
    )


def parameters_on(pad: Pad, parameters: str | Path | ParameterSet | None) -> ParameterSet:
    """The parameter set of a name, a file or itself; by default the one fitted on such a pad."""
    if parameters is None:
        parameters = "fitted" if pad.plane else "fitted_pad"
    return parameter_set(parameters)


def _resolve_trajectory(
    trajectory: Trajectory | None,
    stimulus: WaveformLike | None,
    press_um: float | None,
    press_n: float | None,
    preindent_um: float,
) -> Trajectory:
    """The trajectory of the one argument that describes it."""
    choices = {
        "trajectory": trajectory, "stimulus": stimulus, "press_um": press_um, "press_n": press_n
    }  # fmt: skip
    given = [argument for argument, value in choices.items() if value is not None]
    if len(given) != 1:
        expected = f"one of {', '.join(choices)}"
        if not given:
            raise UsageError(f"is missing: expected {expected}", argument="trajectory")
        problem = f"cannot be combined with {given[0]}: expected {expected}"
        raise UsageError(problem, argument=given[1], expected=expected)
    if stimulus is not None:
        return Trajectory.from_waveform(stimulus, preindent_um)
    if trajectory is None:
        return Trajectory.press(press_um, press_n)
    if not isinstance(trajectory, Trajectory):
        expected = "a Trajectory, as Trajectory.press, slide or from_table makes it"
        raise UsageError(argument="trajectory", found=trajectory, expected=expected)
    return trajectory.preindented(preindent_um)
