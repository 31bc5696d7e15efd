"""`fembridge.touch` and `fembridge.receptive_field`: the commands' work, in a notebook."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fembridge.errors import UsageError
from fembridge.stimulus import Stimulus

if TYPE_CHECKING:
    from fembridge.touching.field import ReceptiveField
    from fembridge.touching.pad import Pad
    from fembridge.touching.population import Population
    from fembridge.touching.shape import Shape
    from fembridge.touching.touch import Touch
    from neural.parameter_sets import ParameterSet

PathLike = str | Path
PAD = "reference"
PARAMETERS = "fitted_pad"


def touch(
    shape: "str | Shape" = "punch",
    *,
    stimulus: str | Stimulus | None = None,
    press_um: float | None = None,
    press_n: float | None = None,
    ramp_ms: float = 50.0,
    hold_ms: float = 500.0,
    slide_mm_per_s: float | None = None,
    direction_deg: float = -90.0,
    duration_ms: float = 1000.0,
    path: PathLike | None = None,
    pins: PathLike | None = None,
    at_mm: tuple[float, float] = (0.0, 0.0),
    angle_deg: float = 0.0,
    pixel_mm: float | None = None,
    relief_mm: float | None = None,
    friction: float = 0.4,
    population: "str | Population" = "fingertip",
    pad: "str | Pad" = PAD,
    parameters: "str | ParameterSet" = PARAMETERS,
    preindent_um: float | None = None,
    repeats: int = 1,
    noise_mv: float = 0.0,
    seed: int = 0,
    log: Callable[[str], None] = lambda line: None,
) -> "Touch":
    """Press, vibrate or slide a shape on a whole fingertip: every afferent's spikes.

    Parameters
    ----------
    shape
        A `Shape`, a word such as ``bar:width_mm=1``, or a file of heights (.png, .csv)
        with `pixel_mm` and, of a picture, `relief_mm`.
    stimulus
        An id, a `Stimulus` or a waveform's path: the shape's depth. Else `press_um` or
        `press_n`: ramp-and-hold, or while it slides.
    slide_mm_per_s, direction_deg, duration_ms
        The shape slides that way, 0 degrees is to the right, 90 towards the tip.
    path
        A table ``time_ms,x_mm,z_mm`` with ``depth_um`` or ``force_n``.
    pins
        In place of a shape, a table ``x_mm,z_mm,diameter_mm,stimulus``.
    at_mm, angle_deg
        Where the shape's middle is at first, and how far it is turned.
    population
        A `Population`, ``fingertip``, ``grid``, ``line``, ``one_each``, or a table.
    pad
        ``reference``, a file that ``fembridge pad`` made, or a `Pad`.
    preindent_um
        Depth before time 0 of a stimulus. None: as in the fit of the parameters.
    repeats, noise_mv, seed
        Trials, the noise of the membrane in mV after 1 ms, and its seed.

    Returns
    -------
    Touch
        ``population``, ``spikes`` and ``rates`` (DataFrames), ``stress_pa``, ``force_n``,
        ``depth_um``; ``fb.plot(it)`` is the pad from above, ``write(folder)`` the tables
        of the command.

    Raises
    ------
    UsageError, StimulusError, TableError
        Words, numbers or files that mean nothing, or a shape beside the pad.
    ResponseError
        A pad that was altered.

    Examples
    --------
    >>> import fembridge as fb
    >>> result = fb.touch("punch:diameter_mm=1", press_um=200, population="one_each")
    >>> result.rates["afferent"].tolist()
    ['SA', 'RA', 'PC']
    """
    from fembridge.touching.pad import Pad, pad_named
    from fembridge.touching.population import Population, population_named
    from fembridge.touching.shape import Shape, shape_named
    from fembridge.touching.touch import Pins, touch_pins, touch_skin

    skin = pad if isinstance(pad, Pad) else pad_named(pad)
    chosen = _parameters(parameters)
    units = population
    if not isinstance(units, Population):
        units = population_named(units, skin.finger)
    depth_um = chosen.preindent_um if preindent_um is None else preindent_um
    common: dict[str, Any] = {
        "trials": repeats,
        "noise_mv": noise_mv,
        "seed": seed,
        "origin": {"parameter_set": chosen.name, "seed": seed},
    }
    if pins is not None:
        others = (stimulus, press_um, press_n, slide_mm_per_s, path)
        if any(each is not None for each in others):
            raise UsageError("pins have waveforms of their own: no other way beside them")
        array = Pins.read(pins, preindent_um=depth_um)
        return touch_pins(skin, array, units, chosen.parameters, **common)
    if not isinstance(shape, Shape):
        shape = shape_named(shape, pixel_mm, relief_mm)
    shape = shape.turned(angle_deg).moved(*at_mm)
    way = _way(
        stimulus, press_um, press_n, ramp_ms, hold_ms, slide_mm_per_s, direction_deg,
        duration_ms, path, depth_um, log,
    )  # fmt: skip
    if stimulus is not None and depth_um and preindent_um is None:
        log(
            f"parameters {chosen.name}: the shape is {depth_um:g} um deep before time 0, as "
            "in their fit"
        )
    return touch_skin(skin, shape, way, units, chosen.parameters, friction=friction, **common)


def receptive_field(
    afferent: str = "RA",
    *,
    probe_diameter_mm: float = 0.5,
    depth_um: Sequence[float] = (100.0, 200.0, 300.0, 400.0, 500.0),
    times_threshold: Sequence[float] = (),
    criterion: float = 0.1,
    frequency_hz: float | None = None,
    step_mm: float = 0.25,
    pad: "str | Pad" = PAD,
    parameters: "str | ParameterSet" = PARAMETERS,
) -> "ReceptiveField":
    """Where a probe makes the median afferent of a class fire, and over what area.

    Parameters
    ----------
    depth_um
        Depths of a ramp-and-hold press, or with `frequency_hz` amplitudes of a sinusoid.
    times_threshold
        Further depths, as multiples of the least that fires it at its hot spot.
    criterion
        Share of the impulses at the hot spot that counts as an answer, one at least.

    Returns
    -------
    ReceptiveField
        ``areas`` is a DataFrame ``afferent, depth_um, area_mm2, whole``; ``impulses``
        ``(depth, x, z)`` are the maps; ``fb.plot(it)`` shows them.

    Examples
    --------
    >>> import fembridge as fb
    >>> field = fb.receptive_field("SA", depth_um=[200], step_mm=1.0)
    >>> list(field.areas.columns)
    ['afferent', 'depth_um', 'area_mm2', 'whole']
    """
    from fembridge.touching.field import receptive_field as field_of
    from fembridge.touching.pad import Pad, pad_named

    skin = pad if isinstance(pad, Pad) else pad_named(pad)
    return field_of(
        skin,
        afferent,
        _parameters(parameters).parameters,
        probe_diameter_mm,
        depth_um,
        times_threshold=times_threshold,
        criterion=criterion,
        frequency_hz=frequency_hz,
        step_mm=step_mm,
    )


def _parameters(parameters: "str | ParameterSet") -> "ParameterSet":
    from neural.parameter_sets import parameter_set_or_file

    return parameter_set_or_file(parameters) if isinstance(parameters, str) else parameters


def _way(
    stimulus: str | Stimulus | None,
    press_um: float | None,
    press_n: float | None,
    ramp_ms: float,
    hold_ms: float,
    slide_mm_per_s: float | None,
    direction_deg: float,
    duration_ms: float,
    path: PathLike | None,
    preindent_um: float,
    log: Callable[[str], None],
) -> Any:  # noqa: ANN401 - a Way, imported late
    """The one way that was asked for."""
    from fembridge.stimulus_file import stimuli_of
    from fembridge.touching.touch import Way

    if path is not None:
        if any(each is not None for each in (stimulus, press_um, press_n, slide_mm_per_s)):
            raise UsageError("a path says how the shape moves: nothing else beside it")
        return Way.read(path)
    if stimulus is not None:
        if press_um is not None or press_n is not None or slide_mm_per_s is not None:
            raise UsageError("a stimulus says how deep the shape goes: no press or slide beside it")
        if isinstance(stimulus, Stimulus):
            return Way.of_stimulus(stimulus)
        found = stimuli_of(stimulus, preindent_um, log=log)
        if len(found) != 1:
            raise UsageError(f"stimulus {stimulus!r} names {len(found)} stimuli, expected one")
        return Way.of_stimulus(found[0])
    if press_um is None and press_n is None:
        raise UsageError("how is the shape pressed? a stimulus, press_um, press_n, path or pins")
    if slide_mm_per_s is not None:
        return Way.slide(slide_mm_per_s, press_um, press_n, duration_ms, direction_deg)
    return Way.hold(press_um, press_n, ramp_ms, hold_ms)
