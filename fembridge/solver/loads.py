"""Waveforms of a deck that is driven by a force or a pressure instead of a displacement.

A stimulus of the catalogue is in um; `newton_per_um` or `mpa_per_um` make of each um a load. A
waveform of a load (``force_n``, ``pressure_mpa``, see `fembridge.io.waveform_file`) needs no scale.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from decks.own_model import LoadScale
from fembridge.errors import UsageError
from fembridge.stimulus import Stimulus

_ARGUMENTS = {"force": "newton_per_um", "pressure": "mpa_per_um"}


def load_scale(
    newton_per_um: float | None, mpa_per_um: float | None, stimuli: Sequence[Stimulus] = ()
) -> LoadScale | None:
    """The load that the arguments or the waveforms name; None for a displacement.

    Raises
    ------
    UsageError
        Both arguments, a scale that is not more than 0, waveforms of several quantities.
    """
    scales = {"force": newton_per_um, "pressure": mpa_per_um}
    requested = {quantity: value for quantity, value in scales.items() if value is not None}
    if len(requested) > 1:
        raise UsageError("cannot be combined with newton_per_um", argument="mpa_per_um")
    for quantity, per_um in requested.items():
        try:
            return LoadScale(quantity, per_um)
        except UsageError as error:
            error.argument = _ARGUMENTS[quantity]
            raise
    loads = {load_of(stimulus) for stimulus in stimuli}
    if len(loads) > 1:
        raise UsageError(
            "has waveforms of a load and others: --newton-per-um or --mpa-per-um (newton_per_um, "
            "mpa_per_um) makes loads of all",
            argument="stimulus",
        )
    return next(iter(loads), None)


def load_of(stimulus: Stimulus) -> LoadScale | None:
    """The load that the samples of a waveform stand for; None for a displacement."""
    load: Any = stimulus.origin.get("load")
    return LoadScale(**load) if isinstance(load, Mapping) else None


def in_scale(
    stimulus: Stimulus, load: LoadScale | None, requested: LoadScale | None = None
) -> Stimulus:
    """`stimulus` in the um of `load`, that of a deck or a map.

    `requested` is the load of one um of a stimulus in um. Default: None, that of `load`.

    Raises
    ------
    UsageError
        A load for a displacement, or another quantity.
    """
    stated = load_of(stimulus)
    source = stated or requested or load
    if source is None:
        return stimulus
    if load is None:
        if stated:
            raise _mismatch(stimulus, source, "a displacement")
        problem = "is for a load, a displacement drives this model"
        raise UsageError(problem, argument=_ARGUMENTS[source.quantity])
    if source.quantity != load.quantity:
        raise _mismatch(stimulus, source, f"a {load.quantity}")
    factor = source.per_um / load.per_um
    if factor == 1.0:
        return stimulus
    return replace(
        stimulus,
        displacement_um=factor * stimulus.displacement_um,
        preindent_um=factor * stimulus.preindent_um,
    )


def _mismatch(stimulus: Stimulus, source: LoadScale, driven: str) -> UsageError:
    return UsageError(
        f"{stimulus.id} is a {source.quantity} in {source.unit}, {driven} drives this model",
        argument="stimulus",
        found=source.quantity,
        expected=driven,
    )
