"""Options that verbs share, each described once; a verb names those that it takes."""

import argparse
from collections.abc import Callable, Iterable, Sequence
from inspect import signature
from typing import TYPE_CHECKING, Any, get_args

if TYPE_CHECKING:
    from decks.probe import Probe

WAVE = ("dt_ms", "full_scale_um")
STIMULUS = ("stimulus", "preindent_um", "seed", "slide_mm_per_s", *WAVE, "window_ms")
FINGER = ("finger", "probe_shape", "probe_diameter_mm", "probe_fillet_mm", "probe_x_mm")
SOLVING = ("whole_section", "inertia", "law")
LIMITS = ("threads", "jobs", "time_limit", "no_cache")
STORED_FINGER: dict[str, Any] = {
    "choices": ("quick", "paper"),
    "metavar": None,
    "help": "whose stored response gives the stress (default: quick)",
}
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


_OPTIONS: dict[str, dict[str, Any]] = {
    "stimulus": {
        "action": Words,
        "required": True,
        "metavar": "ID|FILE",
        "help": "sine_20_250, a set as noise_25_250 or all, ramp_300_100_200_100 (300 um deep "
        "in 100 ms, held for 200, back in 100), or a waveform: .csv with time_ms and "
        "displacement_um, .wav, .npy; several as words or with commas",
    },
    "dt_ms": {
        "type": float,
        "metavar": "MS",
        "help": "time between two samples of an .npy waveform",
    },
    "full_scale_um": {
        "type": float,
        "metavar": "UM",
        "help": "full scale of a .wav waveform that does not hold it itself",
    },
    "window_ms": {
        "type": window,
        "metavar": "START:END",
        "help": "count spikes after START up to END (default: the window of the stimulus; of "
        "one's own all of it)",
    },
    "preindent_um": {
        "type": float,
        "metavar": "DEPTH",
        "help": "depth of the probe before time 0 (default: as in the fit of the parameters)",
    },
    "seed": {"type": int, "help": "draw other noise than the catalogue's (>= 0)"},
    "slide_mm_per_s": {
        "type": float,
        "metavar": "V",
        "help": "the probe also slides along x from time 0 on (default: it does not)",
    },
    "finger": {
        "default": "quick",
        "metavar": "NAME|FILE.toml",
        "help": "quick (3 100 elements), paper (17 702) or a file (default: quick)",
    },
    "probe_shape": {
        "choices": ("cylinder", "flat"),
        "default": "cylinder",
        "help": "default: cylinder",
    },
    "probe_diameter_mm": {"type": float, "default": 1.0, "metavar": "D", "help": "default: 1"},
    "probe_fillet_mm": {
        "type": float,
        "metavar": "R",
        "help": "of a flat probe's edges (default: 0.1, at most a quarter of its width)",
    },
    "probe_x_mm": {
        "type": float,
        "default": 0.0,
        "metavar": "X",
        "help": "place of the probe across the finger (default: 0)",
    },
    "whole_section": {
        "action": "store_true",
        "help": "solve both halves of a section whose halves are mirror images (default: "
        "the right one, for waveforms in CalculiX)",
    },
    "inertia": {
        "action": "store_true",
        "help": "the skin's mass counts while the probe follows its waveform",
    },
    "law": {
        "choices": ("linear", "neo-hookean"),
        "default": "linear",
        "help": "of skin and tissue under large strain; the same at rest (default: linear)",
    },
    "observed": {
        "required": True,
        "metavar": "RATES.csv",
        "help": "what to fit to: a table stimulus,afferent,rate_ips",
    },
    "response": {
        "metavar": "DIR|FILE.toml",
        "help": "or a response of your own, as `fembridge simulate` keeps it",
    },
    "pad": {
        "default": "reference",
        "metavar": "NAME|FILE.npz",
        "help": "reference; of touch also plane, the ridged section, endless along z; or a file "
        "(default: reference)",
    },
    "endings_mm": {
        "type": float,
        "default": 1.2,
        "metavar": "MM",
        "help": "around an SA or RA unit's ending are eight others, half as sensitive; it feels by "
        "the one that is driven most (default: 1.2; 0 is a point)",
    },
    "sa_von_mises": {
        "action": "store_true",
        "help": "SA units read von Mises stress, as in the paper, in place of compression and "
        "stretch",
    },
    "export": {
        "action": Several,
        "default": [],
        "choices": ("npz", "mat", "nwb", "neo", "sonata"),
        "help": "also write the spikes for other programs, see docs/recording.md",
    },
    "parameters": {
        "metavar": "NAME",
        "help": "neural parameters: published (Table 2 of the paper), fitted, or a TOML file; "
        "what a file leaves out is that of its base (default: %(default)s)",
    },
    "threads": {
        "type": int,
        "metavar": "N",
        "help": "threads of each run (default: OMP_NUM_THREADS, or for run 1, else all cores)",
    },
    "jobs": {
        "type": int,
        "default": 1,
        "metavar": "N",
        "help": "runs at the same time (default: 1)",
    },
    "time_limit": {
        "type": float,
        "dest": "time_limit_s",
        "metavar": "S",
        "help": "stop a run after so many seconds (default: never)",
    },
    "no_cache": {
        "action": "store_false",
        "dest": "cache",
        "help": "solve also what was solved before on this machine",
    },
}


def add_options(
    parser: argparse._ActionsContainer,
    names: Iterable[str],
    **changed: Any,  # noqa: ANN401 - as argparse takes it
) -> None:
    """Add the shared options `names`; `changed` differs from what they share."""
    for name in names:
        also = ("--waveform",) if name == "stimulus" else ()
        parser.add_argument(option(name), *also, **{**_OPTIONS[name], **changed})


def add_from(
    parser: argparse._ActionsContainer,
    function: Callable[..., Any],
    **words: str | tuple[str | Iterable[str], str],
) -> None:
    """Add options that are arguments of a `function` of the API: type and default are its own.

    `words` are by argument its help, or its metavar or choices and its help, without the
    default.
    """
    arguments = signature(function).parameters
    for name, text in words.items():
        what, meaning = (None, text) if isinstance(text, str) else text
        default, annotation = arguments[name].default, arguments[name].annotation
        if default is False:
            parser.add_argument(option(name), action="store_true", help=meaning)
            continue
        kinds = get_args(annotation) or (annotation,)
        how: dict[str, Any] = {"type": next((k for k in (float, int) if k in kinds), str)}
        how |= {"metavar": what} if isinstance(what, str | None) else {"choices": tuple(what)}
        shown = default
        if isinstance(default, tuple):
            how |= {"action": Several}
            default, shown = list(default), ",".join(f"{each:g}" for each in default)
        said = "" if shown in (None, "") else f"default: {shown}".removesuffix(".0")
        about = f"{meaning} ({said})" if meaning and said else meaning or said
        parser.add_argument(option(name), default=default, help=about, **how)


def add_output_option(parser: argparse.ArgumentParser, default: str) -> None:
    """Where to."""
    parser.add_argument(
        "-o", "--output", type=_folder, default=default, metavar="DIR", help=f"default: {default}"
    )


def option(name: str) -> str:
    """Option that an argument of the API has on the command line."""
    return f"--{name.replace('_', '-')}"


def words_of(args: argparse.Namespace, function: Callable[..., Any]) -> dict[str, Any]:
    """Arguments of a `function` of the API that are options of the same names."""
    return {name: getattr(args, name) for name in signature(function).parameters if name in args}


def probe_from(args: argparse.Namespace) -> "Probe":
    """The probe that the options describe."""
    from decks.probe import Probe
    from fembridge.errors import FingerError, UsageError

    if args.probe_fillet_mm is not None and args.probe_shape != "flat":
        raise UsageError("--probe-fillet-mm is for --probe-shape flat")
    try:
        return Probe(
            shape=args.probe_shape,
            diameter_mm=args.probe_diameter_mm,
            fillet_mm=args.probe_fillet_mm,
            x_mm=args.probe_x_mm,
        )
    except FingerError as error:
        raise UsageError(f"probe: {error}") from error


def _folder(word: str) -> str:
    """Refuse an empty word, such as a variable that a script forgot to set."""
    if not word:
        raise argparse.ArgumentTypeError("expected the name of a folder, got ''")
    return word
