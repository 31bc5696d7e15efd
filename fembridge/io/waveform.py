"""The waveforms that a user names: ids of the catalogue, files, tables and arrays.

Every public function that takes a `stimulus` resolves it here, by one rule for the
pre-indentation: the depth is added to a waveform that begins at 0, and a waveform that begins
deeper keeps its own depth.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from hashlib import sha256
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from decks.stimuli import DECIMALS, Noise, named
from fembridge.errors import StimulusError, UsageError

if TYPE_CHECKING:
    import pandas
    from numpy.typing import ArrayLike

    from fembridge.stimulus import Stimulus
    from fembridge.typing import FloatArray

WaveformLike: TypeAlias = "str | os.PathLike[str] | Stimulus | Waveform | pandas.DataFrame"
Stimuli: TypeAlias = "WaveformLike | Sequence[WaveformLike]"
"""What an argument `stimulus` takes; see `resolve_stimuli`."""

_EXPECTED = (
    "an id of the catalogue, a Stimulus, a Waveform, a path, a DataFrame, or a list of these"
)
_DEFAULT_NAME = "waveform"


@dataclass(frozen=True, slots=True, eq=False)
class Waveform:
    """A waveform of the probe with its options: a catalogue stimulus, a file, a table or an array.

    Displacement is in um, positive into the skin, 0 at first touch. Samples at any times are
    put on steps of 0.5 ms by PCHIP. Spikes are counted in all of the waveform, of a catalogue
    stimulus in its own window.

    Parameters
    ----------
    source
        An id or a set of the catalogue (``"sine_20_250"``, ``"noise_25_250"``, ``"all"``,
        ``"ramp_300_100_200_100"``: 300 um in 100 ms, held for 200 ms, back in 100 ms); the
        path of a .csv, .wav, .npy or Marc table (.dat); a list of these; a DataFrame with the
        columns ``time_ms`` (or ``time_s``), ``displacement_um`` (or ``displacement_mm``) and,
        for a probe that slides, ``aside_um``, or for a deck of yours ``force_n`` or
        ``pressure_mpa`` instead of displacement; or an array ``(T,)`` of displacement in um,
        which needs `dt_ms`.
    dt_ms
        Time between two samples of an array or .npy file in ms. Default: None.
    full_scale_um
        Displacement in um at full scale of a .wav file. Default: None, as its comment states.
    window_ms
        Start and end in ms of the window in which spikes are counted, the start excluded.
        Default: None, the window of the stimulus.
    slide_mm_per_s
        Speed in mm/s of the probe along x, across the finger, from time 0. Default: None, the
        probe does not slide.
    seed
        Seed of noise, a whole number >= 0. Default: None, the seed of the catalogue.
    name
        Name of the stimulus in results. Default: None, the id, the name of the file, or
        ``waveform``.

    Raises
    ------
    UsageError
        An array without a time step, or an option that the source does not use.

    Examples
    --------
    >>> import numpy as np
    >>> import fembridge as fb
    >>> tap_um = 200 * np.sin(np.pi * np.arange(201) / 200) ** 2
    >>> [tap] = fb.Waveform(tap_um, dt_ms=0.5, name="tap").stimuli(preindent_um=75)
    >>> tap
    Stimulus('tap', 201 samples every 0.5 ms, 75 to 275 um)
    """

    source: str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | pandas.DataFrame | ArrayLike
    dt_ms: float | None = field(default=None, kw_only=True)
    full_scale_um: float | None = field(default=None, kw_only=True)
    window_ms: tuple[float, float] | None = field(default=None, kw_only=True)
    slide_mm_per_s: float | None = field(default=None, kw_only=True)
    seed: int | None = field(default=None, kw_only=True)
    name: str | None = field(default=None, kw_only=True)

    def __repr__(self) -> str:
        source: Any = self.source
        if self._names is None:
            kind = "DataFrame" if _is_table(source) else "array"
            shown = f"{kind} of {len(source)} samples"
        else:
            shown = repr(source)
        options = [
            f"{item.name}={value!r}"
            for item in fields(self)[1:]
            if (value := getattr(self, item.name)) is not None
        ]
        return f"Waveform({', '.join([shown, *options])})"

    def __post_init__(self) -> None:
        if self.seed is not None and self.seed < 0:
            raise UsageError(argument="seed", found=self.seed, expected="0 or more")
        if self._names is not None:
            return
        if not _is_table(self.source):
            samples_um = _to_samples(self.source)
            if self.dt_ms is None or not 0 < self.dt_ms < math.inf:
                raise UsageError(
                    argument="dt_ms", found=self.dt_ms, expected="the time step of the array in ms"
                )
            object.__setattr__(self, "source", samples_um)
        elif self.dt_ms is not None:
            raise UsageError("is for an array or a .npy file, not for a table", argument="dt_ms")
        for argument, source_kind in (("full_scale_um", "a .wav file"), ("seed", "noise")):
            if getattr(self, argument) is not None:
                raise UsageError(f"is for {source_kind} only", argument=argument)

    @property
    def _names(self) -> list[str | Path] | None:
        """Ids and paths of the source; None for a table or an array."""
        source: Any = self.source
        if isinstance(source, str | os.PathLike):
            source = [source]
        is_list = isinstance(source, Sequence)
        if is_list and all(isinstance(item, str | os.PathLike) for item in source):
            return [item if isinstance(item, str) else Path(item) for item in source]
        return None

    def stimuli(self, preindent_um: float = 0.0) -> list[Stimulus]:
        """The samples of each stimulus that the source names: files first, then ids.

        Parameters
        ----------
        preindent_um
            Depth of the probe in um before time 0, added to a waveform that begins at 0.
            Default: 0.

        Raises
        ------
        StimulusError, TableError, UsageError
            An unknown id, a file or a table that is no waveform, a name for several stimuli.
        """
        names = self._names
        stimuli = (
            [self._from_values(preindent_um)] if names is None else self._named(names, preindent_um)
        )
        if self.name is not None:
            if len(stimuli) != 1:
                raise UsageError(
                    f"is for one stimulus, the source names {len(stimuli)}", argument="name"
                )
            stimuli = [replace(stimuli[0], id=self.name)]
        if self.window_ms is not None:
            stimuli = [replace(stimulus, window_ms=self.window_ms) for stimulus in stimuli]
        if self.slide_mm_per_s is not None:
            stimuli = [stimulus.sliding(self.slide_mm_per_s) for stimulus in stimuli]
        return stimuli

    def _named(self, names: list[str | Path], preindent_um: float) -> list[Stimulus]:
        from decks.synthesis import make_stimulus
        from fembridge.io.waveform_file import read_stimulus

        paths, entries = named(names)
        suffixes = {path.suffix.lower() for path in paths}
        for argument, suffix in (("dt_ms", ".npy"), ("full_scale_um", ".wav")):
            if getattr(self, argument) is not None and suffix not in suffixes:
                raise UsageError(f"is for a {suffix} file, none is named", argument=argument)
        stimuli = [
            read_stimulus(path, preindent_um, self.dt_ms, self.full_scale_um) for path in paths
        ]
        if self.seed is not None and not any(isinstance(entry, Noise) for entry in entries):
            raise UsageError("is for noise, none is named", argument="seed")
        return stimuli + [make_stimulus(entry, preindent_um, self.seed) for entry in entries]

    def _from_values(self, preindent_um: float) -> Stimulus:
        """The stimulus of a table or an array."""
        import numpy as np

        from fembridge.io.waveform_file import Samples, read_samples, stimulus_from_samples

        label = self.name or _DEFAULT_NAME
        source: Any = self.source
        if _is_table(source):
            samples = read_samples(source)
        else:
            samples = Samples(np.arange(source.size) * self.dt_ms, source)
        aside_um = samples.aside_um
        columns = [*samples[:2], *([] if aside_um is None else [aside_um])]
        checksum = sha256(np.stack(columns).tobytes()).hexdigest()
        origin = {"family": "own", "sha256": checksum}
        return stimulus_from_samples(samples, preindent_um, label, origin)


def resolve_stimuli(
    stimulus: Stimuli, preindent_um: float = 0.0, *, loads: bool = False
) -> list[Stimulus]:
    """The stimuli that `stimulus` names, each once: values first, then files, then ids.

    Parameters
    ----------
    stimulus
        An id or a set of the catalogue, a `Stimulus`, a `Waveform`, the path of a waveform
        file, a DataFrame ``time_ms,displacement_um``, or a list of these.
    preindent_um
        Depth of the probe in um before time 0, added to each waveform that begins at 0. A
        `Stimulus` with its own pre-indentation and a file that begins deeper keep their depth.
        Default: 0.
    loads
        Whether a waveform may be a force or a pressure. Default: False.

    Raises
    ------
    StimulusError, UsageError
        No such id or file, another type of value, two waveforms of one name.
    TableError
        A file with a row that is no sample.
    """
    from fembridge.stimulus import Stimulus

    if hasattr(stimulus, "dtype"):
        raise _no_time_step()
    depth_um: object = preindent_um
    if not (isinstance(depth_um, Real) and 0 <= float(depth_um) < math.inf):
        raise UsageError(
            argument="preindent_um", found=preindent_um, expected="a finite number, 0 or more"
        )
    is_one = isinstance(stimulus, str | os.PathLike | Stimulus | Waveform) or _is_table(stimulus)
    if not is_one and not isinstance(stimulus, Sequence):
        raise UsageError(argument="stimulus", found=stimulus, expected=_EXPECTED)
    items: Sequence[Any] = [stimulus] if is_one else stimulus  # type: ignore[assignment] # narrowed above
    stimuli: list[Stimulus] = []
    names: list[str | Path] = []
    for item in items:
        if isinstance(item, Stimulus):
            stimuli.append(_preindented(item, preindent_um))
        elif isinstance(item, Waveform):
            stimuli += item.stimuli(preindent_um)
        elif isinstance(item, str):
            names.append(item)
        elif isinstance(item, os.PathLike):
            names.append(Path(item))
        elif _is_table(item):
            stimuli += Waveform(item).stimuli(preindent_um)
        elif hasattr(item, "dtype") or isinstance(item, int | float):
            raise _no_time_step()
        else:
            raise UsageError(argument="stimulus", found=item, expected=_EXPECTED)
    if names or not stimuli:
        stimuli += Waveform(names).stimuli(preindent_um)
    for item in stimuli:
        if not loads and "load" in item.origin:
            raise UsageError(
                f"{item.id} is a force or a pressure, expected a displacement; a deck of your own "
                "takes it (--base-deck)",
                argument="stimulus",
                found=item.id,
                expected="a displacement",
            )
    ids = [item.id for item in stimuli]
    if len(set(ids)) < len(ids):
        duplicate = max(ids, key=ids.count)
        raise UsageError(
            f"has two waveforms {duplicate!r}: rename one, or use fb.Waveform(..., name=...)",
            argument="stimulus",
        )
    return stimuli


def check_preindentation(stimuli: Sequence[Stimulus], preindent_um: float | None) -> None:
    """Refuse a requested `preindent_um` that none of `stimuli` has.

    Raises
    ------
    UsageError
        All of them begin at their own depth, such as a file that starts in the skin.
    """
    depths_um = sorted({stimulus.preindent_um for stimulus in stimuli})
    if preindent_um is not None and preindent_um not in depths_um:
        raise UsageError(
            f"is {preindent_um:g}, but {stimuli[0].id} begins at its own depth, "
            f"{depths_um[0]:g} um: omit it",
            argument="preindent_um",
            found=preindent_um,
        )


def _preindented(stimulus: Stimulus, preindent_um: float) -> Stimulus:
    """`stimulus`, deeper by `preindent_um` if it begins at 0 without a pre-indentation."""
    if not preindent_um or stimulus.preindent_um or stimulus.displacement_um[0] > 0:
        return stimulus
    import numpy as np

    depth_um = np.round(stimulus.displacement_um + preindent_um, DECIMALS)
    return replace(stimulus, displacement_um=depth_um, preindent_um=preindent_um)


def _is_table(source: object) -> bool:
    """Whether `source` is a DataFrame; pandas is not imported for that."""
    return hasattr(source, "columns") and hasattr(source, "to_numpy")


def _to_samples(source: object) -> FloatArray:
    """Displacement ``(T,)`` in um of an array-like."""
    import numpy as np

    try:
        samples_um = np.array(source, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise UsageError(argument="source", found=source, expected=_EXPECTED) from error
    if samples_um.ndim != 1:
        raise StimulusError(f"has shape {samples_um.shape}, expected (T,)", argument="source")
    return samples_um


def _no_time_step() -> UsageError:
    return UsageError(
        "is an array, whose time step is unknown: use fb.Waveform(array, dt_ms=...)",
        argument="stimulus",
    )
