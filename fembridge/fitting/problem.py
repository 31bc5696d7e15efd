"""Observed rates and the stress under each stimulus, made a problem for the search.

A group of stimuli is one objective: sinusoids of one frequency, diharmonics of one
pair of components, noises of one band.
"""

from collections.abc import Sequence

import numpy as np

from decks.stimuli import DT_MS, Diharmonic, Entry, Noise, Sine, number_text, resolve
from decks.waveform import make_stimulus
from fembridge.errors import ResponseError, UsageError
from fembridge.observed import FAMILIES, ObservedRates
from fembridge.response.response_map import ResponseMap
from neural.drive_model import Drive
from neural.fit_problem import FitProblem


def group_of(entry: Entry) -> str:
    """Name the group that `entry` is in: ``20 Hz``, ``10+50 Hz`` or ``5-25 Hz``."""
    numbers = [number_text(number) for number in entry.numbers().values()]
    match entry:
        case Sine():
            return f"{numbers[0]} Hz"
        case Diharmonic():
            return f"{numbers[0]}+{numbers[1]} Hz"
        case Noise():
            return f"{numbers[0]}-{numbers[1]} Hz"


def observed_entries(
    observed: ObservedRates, afferent: str, families: Sequence[str] = FAMILIES
) -> tuple[Entry, ...]:
    """Give the stimuli of `families` with an observed rate of `afferent`."""
    stimuli, _ = observed.of(afferent)
    entries = (resolve(stimulus)[0] for stimulus in stimuli)
    return tuple(entry for entry in entries if entry.family in families)


def fit_problem(
    observed: ObservedRates,
    response: ResponseMap,
    drive: Drive,
    *,
    families: Sequence[str] = FAMILIES[:1],
    preindent_um: float = 0.0,
    cells: int = 0,
) -> FitProblem:
    """Put together what a fit of one class minimises.

    Parameters
    ----------
    drive
        Its row says which class is fitted, and which stress it reads.
    families
        The stimuli to take of `observed`, by family.
    preindent_um
        Depth of the probe before time 0.
    cells
        Cells of a candidate; 0: as many as the drive has.

    Returns
    -------
    FitProblem
        Stimuli stand in the order of `observed`; each is counted in its own window.

    Raises
    ------
    UsageError
        No observed rate of this class and these families.
    ResponseError
        No such afferent in `response`, or a stimulus deeper than it reaches.
    """
    entries = observed_entries(observed, drive.afferent, families)
    if not entries:
        known = {entry.family for entry in observed_entries(observed, drive.afferent)}
        raise UsageError(
            f"no observed rates of {drive.afferent} of family "
            f"{' or '.join(families)}, only of {', '.join(sorted(known))}: "
            f"{observed.path}"
        )
    classes = [place.afferent for place in response.places]
    if drive.afferent not in classes:
        raise ResponseError(f"no {drive.afferent} in the response, only {', '.join(classes)}")
    column = classes.index(drive.afferent)
    models = {drive.afferent: drive}
    stimuli = [make_stimulus(entry, preindent_um=preindent_um) for entry in entries]
    traces = [response.traces(each, models)[column] for each in stimuli]
    names, rate_ips = observed.of(drive.afferent)
    by_name = dict(zip(names, rate_ips.tolist(), strict=True))
    return FitProblem(
        drive=drive,
        stress_pa=np.stack([trace.stress_pa for trace in traces], -1),
        observed_ips=np.array([by_name[entry.id] for entry in entries]),
        groups=tuple(map(group_of, entries)),
        windows_ms=tuple(entry.window_ms for entry in entries),
        dt_ms=DT_MS,
        cells=cells,
    )
