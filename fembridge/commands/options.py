"""Options that verbs share, how an argument of the API becomes an option, and option values.

A `Number` reads each number; `NUMBERS` has the ranges. A `Use` of a verb refuses an option that
the chosen way does not use.
"""

import argparse
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from fembridge.errors import UsageError
from fembridge.number import parse_number, parse_whole_number

if TYPE_CHECKING:
    from decks.probe import Probe

About: TypeAlias = str | tuple[str | Iterable[str] | Mapping[str, Any], str]
"""Help of an option; or its metavar, choices or words of argparse, and its help."""

WAVE = ("dt_ms", "full_scale_um")
STIMULUS = ("stimulus", "preindent_um", "seed", "slide_mm_per_s", *WAVE, "window_ms")
SOLVING = ("whole_section", "inertia", "law")
LIMITS = ("threads", "jobs", "time_limit_s", "cache")
STORED_FINGER = (("quick", "paper"), "whose stored response gives the stress (default: quick)")
"""What ``--finger`` is where nothing is solved."""


@dataclass(frozen=True, slots=True)
class Number:
    """Type of an option that is a number: finite, in ASCII digits, `least` to `most`."""

    least: float = -math.inf
    most: float = math.inf
    whole: bool = False

    def __call__(self, text: str) -> float:
        """The number that `text` states; else ``argparse.ArgumentTypeError``."""
        try:
            value = parse_whole_number(text) if self.whole else parse_number(text)
        except ValueError:
            value = math.nan
        if not self.least <= value <= self.most:
            raise argparse.ArgumentTypeError(f"{text!r}, expected {self}")
        return value

    def __str__(self) -> str:
        kind = "a whole number" if self.whole else "a number"
        least, most = (
            str(end) if isinstance(end, int) else f"{end:.15g}" for end in (self.least, self.most)
        )
        if self.least == ABOVE_ZERO:
            return f"{kind} more than 0" + (f", at most {most}" if self.most < math.inf else "")
        if self.least > -math.inf and self.most < math.inf:
            return f"{kind} from {least} to {most}"
        return f"{kind}, {least} or more" if self.least > -math.inf else f"{kind} that is finite"


ABOVE_ZERO = math.ulp(0.0)
"""The least number of a range that 0 does not belong to."""

# Beyond every length, time and count of a finger, and within what NumPy and timers hold.
_MOST = 10**9
_MOST_WHOLE = 2**63 - 1
_MOST_AT_ONCE = 4096
_COUNT = Number(1, _MOST, whole=True)
_POSITIVE = Number(ABOVE_ZERO, _MOST)
_SECONDS = Number(ABOVE_ZERO, _MOST)
_TURN_DEG = Number(-3600, 3600)
NODE = Number(1, 10**15, whole=True)
"""Number of a node or element, of any solver."""

NUMBERS: Mapping[str, Number] = {
    "angle_deg": _TURN_DEG,
    "at_mm": Number(-1000, 1000),
    "bin_ms": _POSITIVE,
    "cells": Number(1, 1000, whole=True),
    "criterion": Number(ABOVE_ZERO, 1),
    "depth_mm": Number(ABOVE_ZERO, 10),
    "depth_um": Number(ABOVE_ZERO, 10_000),
    "direction_deg": _TURN_DEG,
    "dt_ms": Number(ABOVE_ZERO, 1e6),
    "duration_ms": Number(10, 60_000),
    "endings_mm": Number(0, 3),
    "evaluations": _COUNT,
    "frames": Number(0, _MOST, whole=True),
    "frequency_hz": Number(ABOVE_ZERO, 1000),
    "friction": Number(0, 10),
    "full_scale_um": _POSITIVE,
    "gain_pa": Number(-1e30, 1e30),
    "hold_ms": Number(0.5, 60_000),
    "iteration_limit": _COUNT,
    "jobs": Number(1, _MOST_AT_ONCE, whole=True),
    "longest_ms": _POSITIVE,
    "near_mm": Number(-_MOST, _MOST),
    "noise_mv": Number(0, 1000),
    "pixel_mm": Number(ABOVE_ZERO, 1000),
    "population": Number(4, 10_000, whole=True),
    "preindent_um": Number(0, 10_000),
    "press_n": Number(ABOVE_ZERO, 1000),
    "press_um": Number(ABOVE_ZERO, 10_000),
    "probe_diameter_mm": Number(0.01, 20),
    "probe_fillet_mm": Number(0, 10),
    "probe_x_mm": Number(-1000, 1000),
    "ramp_ms": Number(0.5, 10_000),
    "reach_mm": Number(1, 20),
    "relief_mm": Number(-1000, 1000),
    "repeats": Number(1, 10_000, whole=True),
    "resample_ms": Number(ABOVE_ZERO, 1e6),
    "seed": Number(0, _MOST_WHOLE, whole=True),
    "slide_mm_per_s": Number(-10_000, 10_000),
    "spacing_mm": Number(0.05, 1),
    "stall_limit_s": _SECONDS,
    "step_mm": Number(0.1, 2),
    "stiffness_mpa_per_mm": _POSITIVE,
    "threads": Number(1, _MOST_AT_ONCE, whole=True),
    "time_limit_s": _SECONDS,
    "times_threshold": Number(ABOVE_ZERO, 10_000),
    "window_ms": Number(-_MOST, _MOST),
}
"""By argument: the numbers that an option of this name takes. The API may be narrower."""


@dataclass(frozen=True, slots=True)
class Use:
    """`options`, separated by blanks, are for the ways that `needs` describes.

    They are used where `condition` holds for the parsed arguments, and refused elsewhere.
    """

    options: str
    needs: str
    condition: Callable[[argparse.Namespace], object]


def check_uses(args: argparse.Namespace, uses: Iterable[Use]) -> None:
    """Refuse an option that was written, but that the chosen way does not use.

    Raises
    ------
    UsageError
        Names the option and what it is for.
    """
    for use in uses:
        unused = [name for name in use.options.split() if name in args.explicit]
        if unused and not use.condition(args):
            verb = "is" if len(unused) == 1 else "are"
            raise UsageError(f"{', '.join(unused)} {verb} for {use.needs}")


def names_a_file(names: Iterable[str], *suffixes: str) -> bool:
    """Whether one of `names`, several of which may be joined by commas, ends in a suffix."""
    parts = [part.strip().lower() for name in names for part in name.split(",")]
    return any(part.endswith(suffixes) for part in parts)


PROBE_USES = (
    Use("--probe-fillet-mm", "--probe-shape flat", lambda args: args.probe_shape == "flat"),
)
WAVE_USES = (
    Use("--dt-ms", "a waveform in .npy", lambda args: names_a_file(args.stimulus, ".npy")),
    Use("--full-scale-um", "a waveform in .wav", lambda args: names_a_file(args.stimulus, ".wav")),
)


def window(word: str) -> tuple[float, float]:
    """``START:END`` in ms, the time in which spikes are counted."""
    try:
        start, end = map(NUMBERS["window_ms"], word.split(":"))
    except (ValueError, argparse.ArgumentTypeError):
        start = end = 0.0
    if not start < end:
        raise argparse.ArgumentTypeError(f"expected START:END in ms as 5:250, got {word!r}")
    return start, end


def column(text: str) -> tuple[str, str]:
    """``time=NAME``: what a column is, and its name."""
    key, _, name = map(str.strip, text.partition("="))
    if not (key and name):
        raise argparse.ArgumentTypeError(f"expected time=NAME,value=NAME, got {text!r}")
    return key, name


class Words(argparse.Action):
    """A list of words, each its own or by repetition of the option; `type` is that of an item.

    ``--stimulus a b`` comes as ``--stimulus=a --stimulus=b`` (`fembridge.cli`).
    """

    separator: str | None = None

    def __init__(self, option_strings: Sequence[str], dest: str, **how: Any) -> None:  # noqa: ANN401 - as argparse calls it
        self.item, self.known = how.pop("type", str), tuple(how.pop("choices", ()))
        super().__init__(option_strings, dest, **how)
        if self.known and self.metavar is None:
            self.metavar = ",".join(self.known)

    def items(self, word: str) -> list[Any]:
        """The items of one word."""
        texts = [word] if self.separator is None else word.split(self.separator)
        items = []
        for text in filter(None, map(str.strip, texts)):
            try:
                items.append(self.item(text))
            except argparse.ArgumentTypeError as error:
                raise argparse.ArgumentError(self, str(error)) from error
            if self.known and items[-1] not in self.known:
                raise argparse.ArgumentError(self, invalid_choice(text, self.known))
        if not items:
            raise argparse.ArgumentError(self, f"expected a value, got {word!r}")
        return items

    def takes(self, word: str) -> bool:
        """Whether `word` is an item or several."""
        try:
            self.items(word)
        except argparse.ArgumentError:
            return False
        return True

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,  # noqa: ANN401 - as argparse has it
        option_string: str | None = None,
    ) -> None:
        """Add the items of a word; the first one takes the place of the default."""
        before = getattr(namespace, self.dest)
        before = [] if before is self.default else before
        setattr(namespace, self.dest, [*before, *self.items(values)])


class Several(Words):
    """A list, the items also separated by commas."""

    separator = ","


def invalid_choice(word: str, choices: Sequence[str]) -> str:
    """What is wrong with a `word` that is none of `choices`."""
    from fembridge.store import near_hint

    expected = f"expected one of {', '.join(choices)}"
    return f"invalid choice: {word!r}, {expected}{near_hint(word, choices)}"


_SHARED: Mapping[str, About] = {
    "stimulus": (
        {"also": "--waveform", "action": Words, "metavar": "ID|FILE"},
        "sine_20_250, a set as noise_25_250 or all, ramp_300_100_200_100 (300 um deep "
        "in 100 ms, held for 200, back in 100), or a waveform: .csv with time_ms and "
        "displacement_um, .wav, .npy; several as words or with commas",
    ),
    "dt_ms": ("MS", "time between two samples of an .npy waveform"),
    "full_scale_um": ("UM", "full scale of a .wav waveform that does not hold it itself"),
    "window_ms": (
        {"type": window, "metavar": "START:END"},
        "count spikes after START up to END (default: the window of the stimulus; of one's own "
        "all of it)",
    ),
    "preindent_um": (
        "DEPTH",
        "depth of the probe before time 0 (default: as in the fit of the parameters)",
    ),
    "seed": "draw other noise than the catalogue's (>= 0)",
    "slide_mm_per_s": ("V", "the probe also slides along x from time 0 on (default: it does not)"),
    "finger": ("NAME|FILE.toml", "quick (3 100 elements), paper (17 702) or a file"),
    "whole_section": "solve both halves of a section whose halves are mirror images (default: "
    "the right one, for waveforms in CalculiX)",
    "inertia": "the skin's mass counts while the probe follows its waveform",
    "law": (("linear", "neo-hookean"), "of skin and tissue under large strain; the same at rest"),
    "observed": ("RATES.csv", "what to fit to: a table stimulus,afferent,rate_ips"),
    "response": ("DIR|FILE.toml", "or a response of your own, as `fembridge simulate` keeps it"),
    "pad": (
        "NAME|FILE.npz",
        "reference; of touch also plane, the ridged section, endless along z; or a file",
    ),
    "endings_mm": (
        "MM",
        "around an SA or RA unit's ending are eight others, half as sensitive; it feels by "
        "the one that is driven most; 0 is a point",
    ),
    "sa_von_mises": "SA units read von Mises stress, as in the paper, in place of compression "
    "and stretch",
    "parameters": (
        "NAME",
        "neural parameters: published (Table 2 of the paper), fitted, or a TOML file; "
        "what a file leaves out is that of its base",
    ),
    "threads": (
        "N",
        "threads of each run (default: OMP_NUM_THREADS, or for run 1, else all cores)",
    ),
    "jobs": ("N", "runs at the same time"),
    "time_limit_s": ("S", "stop a run after so many seconds (default: never)"),
    "cache": "solve also what was solved before on this machine",
}
"""By argument."""


def add_from(
    parser: argparse._ActionsContainer,
    function: Callable[..., Any],
    *shared: str,
    **own: About,
) -> None:
    """Add options that are arguments of a `function` of the API: type and default are its own.

    What is said of `shared` ones is here, of the verb's `own` ones in the call; the default
    is added. One that is true by default becomes ``--no-...``.
    """
    arguments = signature(function).parameters
    for name, about in {**own, **{name: _SHARED[name] for name in shared}}.items():
        what, meaning = (None, about) if isinstance(about, str) else about
        default = arguments[name].default
        if isinstance(default, bool):
            flag, action = option(f"no_{name}" if default else name), f"store_{not default}".lower()
            parser.add_argument(flag, action=action, dest=name, help=meaning)
            continue
        kinds = re.findall(r"\w+", str(arguments[name].annotation))
        is_number = {"float", "int"} & set(kinds) and "str" not in kinds
        how: dict[str, Any] = {"type": NUMBERS[name] if is_number else str}
        if isinstance(what, Mapping):
            how |= what
        else:
            how |= {"metavar": what} if isinstance(what, str | None) else {"choices": tuple(what)}
        shown = default
        if default is Parameter.empty:
            how["required"], default, shown = True, None, None
        elif isinstance(default, tuple):
            how["action"], default = Several, list(default)
            shown = ",".join(f"{each:g}" for each in default)
        said = "" if shown in (None, "") else f"default: {shown}".removesuffix(".0")
        text = f"{meaning} ({said})" if meaning and said else meaning or said
        flags = [option(name), how.pop("also", None)]
        parser.add_argument(*filter(None, flags), default=default, dest=name, help=text, **how)


def add_output_option(parser: argparse.ArgumentParser, default: str) -> None:
    """Where to."""
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path(default),
        metavar="DIR",
        help=f"default: {default}",
    )


def add_export_option(parser: argparse.ArgumentParser) -> None:
    """For which programs the spikes are written."""
    parser.add_argument(
        "--export",
        action=Several,
        default=[],
        choices=("npz", "mat", "nwb", "neo", "sonata"),
        help="also write the spikes for other programs, see docs/recording.md",
    )


def add_probe_options(parser: argparse._ActionsContainer) -> None:
    """What the probe is: the fields of `decks.probe.Probe`, which has the defaults."""
    add = parser.add_argument
    add("--probe-shape", choices=("cylinder", "flat"), help="default: cylinder")
    add("--probe-diameter-mm", type=NUMBERS["probe_diameter_mm"], metavar="D", help="default: 1")
    edges = "of a flat probe's edges (default: 0.1, at most a quarter of its width)"
    add("--probe-fillet-mm", type=NUMBERS["probe_fillet_mm"], metavar="R", help=edges)
    across = "across the finger (default: 0)"
    add("--probe-x-mm", type=NUMBERS["probe_x_mm"], metavar="X", help=across)


def probe_from(args: argparse.Namespace) -> "Probe":
    """The probe that the options describe."""
    from decks.probe import Probe
    from fembridge.errors import FingerError

    given = {
        name.removeprefix("probe_"): value
        for name, value in vars(args).items()
        if name.startswith("probe_") and name != "probe_body" and value is not None
    }
    try:
        return Probe(**given)
    except FingerError as error:
        raise UsageError(f"probe: {error}") from error


def option(name: str) -> str:
    """Option that an argument of the API has on the command line; its limits are in s."""
    return f"--{name.replace('limit_s', 'limit').replace('_', '-')}"


def words_of(args: argparse.Namespace, function: Callable[..., Any]) -> dict[str, Any]:
    """Arguments of a `function` of the API that are options of the same names."""
    return {name: getattr(args, name) for name in signature(function).parameters if name in args}
