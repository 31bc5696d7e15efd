"""The parameter sets that are shipped: the paper's, and this project's own fit."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

from fembridge.errors import ParameterError
from neural.parameter_file import ParameterSet, read_parameter_set
from neural.parameters import PUBLISHED

FITTED_FILE = Path(__file__).parent / "fitted.toml"

# Fitted and held out it is better than the published drive on every class:
# ``docs/model_study.md``.
DEFAULT_SET = "fitted"

SET_NAMES = ("published", "fitted")


@cache
def parameter_set(name: str) -> ParameterSet:
    """Give a shipped set: ``published``, Table 2, or ``fitted``.

    Raises
    ------
    ParameterError
        No set of that name.
    """
    if name == "published":
        origin = {"fit": {"source": "Ishizuka et al., Table 2"}}
        return ParameterSet(name, PUBLISHED, origin=MappingProxyType(origin))
    if name == "fitted":
        return read_parameter_set(FITTED_FILE)
    raise ParameterError(
        f"no parameter set {name!r}, expected {' or '.join(SET_NAMES)} or a TOML file"
    )


def held_um() -> float:
    """Depth of the probe before time 0 in the fit of the shipped parameters."""
    return parameter_set("fitted").preindent_um


def parameter_set_or_file(word: str) -> ParameterSet:
    """Give a shipped set by its name, or read the file of that path.

    Raises
    ------
    ParameterError
        Neither is there, or the file is none of parameters.
    """
    if word in SET_NAMES:
        return parameter_set(word)
    if not word:
        return parameter_set(word)
    path = Path(word)
    if path.suffix or path.exists():
        return read_parameter_set(path)
    return parameter_set(word)


def parameter_sets() -> Mapping[str, ParameterSet]:
    """Give all shipped sets by name."""
    return MappingProxyType({name: parameter_set(name) for name in SET_NAMES})
