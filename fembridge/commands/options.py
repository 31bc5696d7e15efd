"""Options that verbs share, options made from the arguments of a public function, and option types.

A type of an option reads its text and raises a `UsageError` with `found` and `expected`; the
parser adds the name of the option. A `Use` refuses an option that the chosen way ignores.
"""

import argparse
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from fembridge import ranges
from fembridge.errors import UsageError
from fembridge.io.number import parse_number, parse_whole_number
from fembridge.ranges import RANGES, Range

if TYPE_CHECKING:
    from decks.probe import Probe
    from fembridge.touching.pad_probe import PadProbe

Description: TypeAlias = str | tuple[str | Iterable[str] | Mapping[str, Any], str]
"""Help of an option; or its metavar, choices or settings of argparse, and its help."""

STIMULUS = ("stimulus", "preindent_um")
WAVEFORM = ("seed", "slide_mm_per_s", "dt_ms", "full_scale_um", "window_ms")
"""Fields of `fembridge.Waveform`."""
SOLVING = ("whole_section", "inertia", "law")
"""Fields of `fembridge.Analysis`."""
LIMITS = ("threads", "jobs", "time_limit_s", "cache")
PAD_PROBE = "--shape --at-mm --ridges --positions --deepest-um"
"""Options of a probe on a pad, beside ``--pad``."""
STORED_FINGER = (("quick", "paper"), "finger of the stored response (default: quick)")
"""``--finger`` of the verbs that solve nothing."""


class Number(Range):
    """Type of an option that is a number: finite, in ASCII digits, `low` to `high`."""

    def __call__(self, text: str) -> float:
        """The number that `text` states; else a `UsageError`."""
        try:
            value = parse_whole_number(text) if self.is_whole else parse_number(text)
        except ValueError:
            value = math.nan
        if not self.contains(value):
            raise UsageError(found=text, expected=str(self))
        return value

    @classmethod
    def within(cls, limits: Range) -> "Number":
        """The type of an option that accepts the numbers within `limits`."""
        return cls(limits.low, limits.high, limits.is_whole)


ABOVE_ZERO = ranges.ABOVE_ZERO
NODE = Number.within(ranges.NODE)
NUMBERS: Mapping[str, Number] = {
    argument: Number.within(limits) for argument, limits in RANGES.items()
}
"""Type of the option of each numeric argument."""


@dataclass(frozen=True, slots=True)
class Use:
    """The case in which options take effect; elsewhere they are refused.

    Parameters
    ----------
    options
        Names of the options, separated by blanks.
    needs
        Completes the message "is for ...".
    condition
        Whether the parsed arguments use the options.
    """

    options: str
    needs: str
    condition: Callable[[argparse.Namespace], object]


def check_uses(args: argparse.Namespace, uses: Iterable[Use]) -> None:
    """Refuse options of the command line that would have no effect.

    Raises
    ------
    UsageError
        `argument` names these options.
    """
    for use in uses:
        unused = [name for name in use.options.split() if name in args.explicit]
        if unused and not use.condition(args):
            verb = "is" if len(unused) == 1 else "are"
            raise UsageError(f"{verb} for {use.needs}", argument=", ".join(unused))


def names_a_file(names: Iterable[str], *suffixes: str) -> bool:
    """Whether one of `names`, which commas may join, ends in one of `suffixes`."""
    parts = [part.strip().lower() for name in names for part in name.split(",")]
    return any(part.endswith(suffixes) for part in parts)


PROBE_USES = (
    Use("--probe-fillet-mm", "--probe-shape flat", lambda args: args.probe_shape == "flat"),
)
WAVE_USES = (
    Use("--dt-ms", "a waveform in .npy", lambda args: names_a_file(args.stimulus, ".npy")),
    Use("--full-scale-um", "a waveform in .wav", lambda args: names_a_file(args.stimulus, ".wav")),
)


def parse_window(text: str) -> tuple[float, float]:
    """Start and end in ms of a counting window ``START:END``."""
    try:
        start, end = map(NUMBERS["window_ms"], text.split(":"))
    except ValueError:
        start = end = 0.0
    if not start < end:
        raise UsageError(found=text, expected="START:END in ms, such as 5:250")
    return start, end


def parse_column(text: str) -> tuple[str, str]:
    """Key and column name of ``time=NAME``."""
    key, _, name = map(str.strip, text.partition("="))
    if not (key and name):
        raise UsageError(found=text, expected="time=NAME,value=NAME")
    return key, name


def parse_gain(text: str) -> float | dict[str, float]:
    """Gain of all classes, or by class: ``SA=2e4,PC=400``."""
    if "=" not in text:
        return NUMBERS["gain_pa"](text)
    gains: dict[str, float] = {}
    for part in text.split(","):
        name, _, number = map(str.strip, part.partition("="))
        if name not in ("SA", "RA", "PC") or name in gains:
            raise UsageError(found=text, expected="a number, or SA=NUMBER,RA=NUMBER,PC=NUMBER")
        gains[name] = NUMBERS["gain_pa"](number)
    return gains


class RepeatedOption(argparse.Action):
    """A list, one item a word or by repetition of the option; `type` is that of an item.

    ``--stimulus a b`` arrives as ``--stimulus=a --stimulus=b`` (`fembridge.cli`).
    """

    separator: str | None = None

    def __init__(self, option_strings: Sequence[str], dest: str, **settings: Any) -> None:  # noqa: ANN401 - as argparse calls it
        self.item_type = settings.pop("type", str)
        self.item_choices = tuple(settings.pop("choices", ()))
        super().__init__(option_strings, dest, **settings)
        if self.item_choices and self.metavar is None:
            self.metavar = ",".join(self.item_choices)

    def items(self, text: str) -> list[Any]:
        """The items of one argument; a `UsageError` names the option."""
        parts = [text] if self.separator is None else text.split(self.separator)
        items = []
        for part in filter(None, map(str.strip, parts)):
            try:
                items.append(self.item_type(part))
            except UsageError as error:
                error.argument = option_name(self)
                raise
            if self.item_choices and items[-1] not in self.item_choices:
                raise choice_error(self, part, self.item_choices)
        if not items:
            raise UsageError(argument=option_name(self), found=text, expected="a value")
        return items

    def accepts(self, text: str) -> bool:
        """Whether `text` is an item or several."""
        try:
            self.items(text)
        except UsageError:
            return False
        return True

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,  # noqa: ANN401 - as argparse has it
        option_string: str | None = None,
    ) -> None:
        """Add the items of an argument; the first ones replace the default."""
        before = getattr(namespace, self.dest)
        before = [] if before is self.default else before
        setattr(namespace, self.dest, [*before, *self.items(values)])


class Several(RepeatedOption):
    """A list, the items also separated by commas."""

    separator = ","


def option_name(action: argparse.Action) -> str:
    """Long name of an option, such as ``--output``, or the metavar of a positional argument."""
    flags = [flag for flag in action.option_strings if flag.startswith("--")]
    return flags[0] if flags else str(action.metavar or action.dest)


def choice_error(action: argparse.Action, text: str, choices: Sequence[str]) -> UsageError:
    """The error of a `text` that is none of the `choices` of an option."""
    from fembridge.host.store import near_hint

    expected = f"one of {', '.join(choices)}"
    problem = f"is {text!r}, expected {expected}{near_hint(text, choices)}"
    return UsageError(problem, argument=option_name(action), found=text, expected=expected)


_SHARED: Mapping[str, Description] = {
    "stimulus": (
        {"also": "--waveform", "action": RepeatedOption, "metavar": "ID|FILE"},
        "ids of the catalogue (sine_20_250), sets (noise_25_250, all), ramp-and-holds "
        "(ramp_300_100_200_100: 300 um in 100 ms, held for 200 ms, back in 100 ms) or "
        "waveforms: .csv with time_ms and displacement_um, .wav, .npy",
    ),
    "dt_ms": ("MS", "time step of an .npy waveform"),
    "full_scale_um": ("UM", "full scale of a .wav waveform, unless the file states it"),
    "window_ms": (
        {"type": parse_window, "metavar": "START:END"},
        "count spikes after START up to END (default: the window of the stimulus; of a waveform "
        "file all of it)",
    ),
    "preindent_um": (
        "DEPTH",
        "pre-indentation: depth of the probe before time 0 (default: that of the fit of the "
        "parameter set)",
    ),
    "seed": "seed of the noise (default: the seed of the catalogue)",
    "slide_mm_per_s": ("V", "slide the probe along x from time 0 on (default: no sliding)"),
    "finger": ("NAME|FILE.toml", "quick (3 100 elements), paper (17 702) or a file"),
    "whole_section": "solve both halves of a symmetric section (default: the right half, for "
    "waveforms in CalculiX)",
    "inertia": "include the inertia of the skin while the probe follows its waveform",
    "law": (
        ("linear", "neo-hookean"),
        "elastic law of skin and tissue without a law in the finger file; both have the same "
        "stiffness at small strain",
    ),
    "observed": ("RATES.csv", "observed rates: a table stimulus,afferent,rate_ips"),
    "unit": (
        "CLASS=UNIT",
        "unit of a class that has several in the map: SA=12,RA=40 (default: of each class the one "
        "with the largest stress)",
    ),
    "response": (
        "DIR|FILE.toml",
        "response map of your own finger, as `fembridge simulate` writes it",
    ),
    "pad": (
        "NAME|FILE.npz",
        "reference; macaque; fingertip or fingertip_macaque (round); for touch also plane (the "
        "ridged section, endless along z); or a file",
    ),
    "endings_mm": (
        "MM",
        "distance from the most sensitive ending of an SA or RA unit up to which its 4 to 9 other "
        "endings lie; the ending with the largest drive counts; 0: a single ending",
    ),
    "sa_von_mises": "SA units respond to von Mises stress, as in the paper, instead of "
    "compression and stretch",
    "parameters": (
        "NAME",
        "parameter set: published (Table 2 of the paper), fitted, or a TOML file; keys that a "
        "file lacks come from its base",
    ),
    "threads": (
        "N",
        "threads of each run (default: OMP_NUM_THREADS; else 1 for the verb run, all cores for "
        "other verbs)",
    ),
    "jobs": ("N", "parallel runs"),
    "time_limit_s": ("S", "stop a run after S seconds (default: never)"),
    "cache": "solve again, without the results of earlier runs on this machine",
}
"""Description of each shared argument."""


def add_from(
    parser: argparse._ActionsContainer,
    function: Callable[..., Any],
    *shared: str,
    **described: Description,
) -> None:
    """Add options that are arguments of a public `function`, with its defaults.

    The default of an argument decides: a text is a text, True or False a flag (``--no-...`` for
    True), a tuple a list; any other argument is a number if it is in `NUMBERS`, else a text. The
    descriptions of `shared` arguments are in this module, those of `described` ones in the call.
    """
    parameters = signature(function).parameters
    for name, description in {**described, **{name: _SHARED[name] for name in shared}}.items():
        form, meaning = (None, description) if isinstance(description, str) else description
        default = parameters[name].default
        if isinstance(default, bool):
            flag, action = option(f"no_{name}" if default else name), f"store_{not default}".lower()
            parser.add_argument(flag, action=action, dest=name, help=meaning)
            continue
        settings: dict[str, Any] = {
            "type": str if isinstance(default, str) else NUMBERS.get(name, str)
        }
        if isinstance(form, Mapping):
            settings |= form
        elif isinstance(form, str | None):
            settings["metavar"] = form
        else:
            settings |= {"choices": tuple(form), "type": str}
        default_text = "" if default in (None, "") else f"{default}"
        if default is Parameter.empty:
            settings["required"], default, default_text = True, None, ""
        elif isinstance(default, tuple):
            settings["action"], default = Several, list(default)
            default_text = ",".join(f"{value:g}" for value in default)
        note = f"default: {default_text}".removesuffix(".0") if default_text else ""
        text = f"{meaning} ({note})" if meaning and note else meaning or note
        flags = [option(name), settings.pop("also", None)]
        parser.add_argument(*filter(None, flags), default=default, dest=name, help=text, **settings)


def add_output_option(parser: argparse.ArgumentParser, default: str) -> None:
    """Add ``-o``: where results are written."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(default),
        metavar="DIR",
        help=f"default: {default}",
    )


def add_export_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--export``: formats of other programs."""
    parser.add_argument(
        "--export",
        action=Several,
        default=[],
        choices=("npz", "mat", "nwb", "neo", "sonata", "events", "aedat4"),
        help="also write the spikes in formats of other programs (docs/how_to/recording.md)",
    )


def add_probe_options(parser: argparse._ActionsContainer) -> None:
    """Add the fields of `decks.probe.Probe`, which has the defaults."""
    add = parser.add_argument
    add("--probe-shape", choices=("cylinder", "flat"), help="default: cylinder")
    add("--probe-diameter-mm", type=NUMBERS["probe_diameter_mm"], metavar="D", help="default: 1")
    fillet = "edge radius of a flat probe (default: 0.1, at most a quarter of its width)"
    add("--probe-fillet-mm", type=NUMBERS["probe_fillet_mm"], metavar="R", help=fillet)
    position = "position across the finger (default: 0)"
    add("--probe-x-mm", type=NUMBERS["probe_x_mm"], metavar="X", help=position)


def add_pad_probe_options(
    parser: argparse.ArgumentParser, stress: argparse._ActionsContainer
) -> None:
    """Add ``--pad`` to the ways to get stress, and the fields of `fembridge.PadProbe`."""
    from fembridge.touching.pad_probe import PadProbe

    stress.add_argument(
        "--pad",
        metavar="NAME|FILE.npz",
        help="a probe on a pad instead: reference; macaque; fingertip or fingertip_macaque "
        "(round); or a file of `fembridge pad`",
    )
    group = parser.add_argument_group("probe on a pad")
    add_from(
        group,
        PadProbe,
        shape=("SHAPE|FILE", "the probe, as punch:diameter_mm=0.7; punch is a pin of 1 mm"),
    )
    group.add_argument(
        "--at-mm",
        type=NUMBERS["at_mm"],
        nargs=2,
        default=(0.0, 0.0),
        metavar=("X", "Z"),
        help="position of probe and units, across and along the finger (default: 0 0)",
    )
    add_from(
        group,
        PadProbe,
        ridges=(
            "NAME",
            "fingerprint ridges, as in touch: loop, whorl, across or along, or none (default: loop "
            "on the pad of a smooth finger)",
        ),
        positions=("N", "positions of the probe across a ridge, over which rates are means"),
        deepest_um=("UM", "largest depth of the probe"),
    )


def pad_probe_use(needs: str = "--pad") -> Use:
    """The options of a probe are for ``--pad``."""
    return Use(PAD_PROBE, needs, lambda args: args.pad is not None)


def pad_probe_from(args: argparse.Namespace) -> "PadProbe | None":
    """The probe on the pad of the options; None without ``--pad``."""
    from fembridge.touching.pad_probe import PadProbe

    if args.pad is None:
        return None
    return PadProbe(**{**words_of(args, PadProbe), "at_mm": tuple(args.at_mm)})


def probe_from(args: argparse.Namespace) -> "Probe":
    """The probe of the options."""
    from decks.probe import Probe
    from fembridge.errors import FingerError

    fields = {
        name.removeprefix("probe_"): value
        for name, value in vars(args).items()
        if name.startswith("probe_") and name != "probe_body" and value is not None
    }
    try:
        return Probe(**fields)
    except FingerError as error:
        failure = UsageError.from_error(error)
        failure.argument = f"probe_{error.argument}"
        raise failure from error


def option(name: str) -> str:
    """Option of an argument, such as ``--depth-um``; limits lose their unit, s."""
    return f"--{name.replace('limit_s', 'limit').replace('_', '-')}"


def words_of(args: argparse.Namespace, function: Callable[..., Any]) -> dict[str, Any]:
    """Values of the arguments of a `function` that are options of the same names."""
    return {name: getattr(args, name) for name in signature(function).parameters if name in args}
