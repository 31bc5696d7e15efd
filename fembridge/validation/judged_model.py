"""The models that a report judges: the one that was asked for, then the published."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from fembridge.errors import UsageError
from fembridge.validation.compared_rates import OBSERVED, TOUCHSIM
from neural import Parameters, ParameterSet
from neural.sets import DEFAULT_SET, SET_NAMES, parameter_set, parameter_set_or_file

PUBLISHED_NAME = "published"
_SHORT_DIGEST = 12


@dataclass(frozen=True, slots=True)
class JudgedModel:
    """Parameters under a name, and how deep the probe stands before a stimulus.

    `word` chooses it on a command line, `source` says in a line where its numbers
    come from, `origin` tells all that is known of that.
    """

    name: str
    parameters: Parameters
    preindent_um: float
    word: str
    source: str
    origin: Mapping[str, object] = field(default_factory=dict)


def judged_models(word: str = DEFAULT_SET) -> tuple[JudgedModel, ...]:
    """Give the model called `word` or in that file, and the published one after it.

    Raises
    ------
    UsageError
        A file that calls its model by the name of another source of rates.
    ParameterError
        No model of that name, or a file that is not there or holds none.
    """
    published = _model(parameter_set(PUBLISHED_NAME), PUBLISHED_NAME)
    if word == PUBLISHED_NAME:
        return (published,)
    judged = _model(parameter_set_or_file(word), word)
    if judged.name in (OBSERVED, TOUCHSIM, PUBLISHED_NAME):
        raise UsageError(
            f"{word}: a model called {judged.name!r} would stand beside another of "
            "that name; give it another (the file's name, or its key 'name')"
        )
    return (judged, published)


def _model(found: ParameterSet, word: str) -> JudgedModel:
    return JudgedModel(
        name=found.name,
        parameters=found.parameters,
        preindent_um=found.preindent_um,
        word=word,
        source=_source(found, word),
        origin=found.origin,
    )


def _source(found: ParameterSet, word: str) -> str:
    if word not in SET_NAMES:
        digest = hashlib.sha256(Path(word).read_bytes()).hexdigest()[:_SHORT_DIGEST]
        return f"file {Path(word).name}, SHA-256 {digest}"
    fit = found.origin.get("fit")
    source = fit.get("source") if isinstance(fit, Mapping) else None
    return str(source or f"parameter set {word!r} of fembridge")
