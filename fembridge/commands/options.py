"""Options that verbs share, and how an argument of the API becomes an option."""

import argparse
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

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


def window(word: str) -> tuple[float, float]:
    """``START:END`` in ms, the time in which spikes are counted."""
    try:
        start, end = map(float, word.split(":"))
    except ValueError:
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
        words = [word] if self.separator is None else word.split(self.separator)
        found = []
        for each in filter(None, map(str.strip, words)):
            try:
                found.append(self.item(each))
            except argparse.ArgumentTypeError as error:
                raise argparse.ArgumentError(self, str(error)) from error
            except ValueError as error:
                kind = getattr(self.item, "__name__", "")
                problem = f"invalid {kind} value: {each!r}"
                raise argparse.ArgumentError(self, problem) from error
            if self.known and found[-1] not in self.known:
                raise argparse.ArgumentError(self, invalid_choice(each, self.known))
        return found

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
        how: dict[str, Any] = {"type": next((k for k in (float, int) if k.__name__ in kinds), str)}
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
        type=_folder,
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
    add("--probe-diameter-mm", type=float, metavar="D", help="default: 1")
    edges = "of a flat probe's edges (default: 0.1, at most a quarter of its width)"
    add("--probe-fillet-mm", type=float, metavar="R", help=edges)
    add("--probe-x-mm", type=float, metavar="X", help="across the finger (default: 0)")


def probe_from(args: argparse.Namespace) -> "Probe":
    """The probe that the options describe."""
    from decks.probe import Probe
    from fembridge.errors import FingerError, UsageError

    given = {
        name.removeprefix("probe_"): value
        for name, value in vars(args).items()
        if name.startswith("probe_") and name != "probe_body" and value is not None
    }
    if "fillet_mm" in given and args.probe_shape != "flat":
        raise UsageError("--probe-fillet-mm is for --probe-shape flat")
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


def _folder(word: str) -> Path:
    """Refuse an empty word, such as a variable that a script forgot to set."""
    if not word:
        raise argparse.ArgumentTypeError("expected the name of a folder, got ''")
    return Path(word)
