"""Whether a parameter set is used with the mechanics on which it was fitted.

Mechanics are described by the name and the digest of the finger or model, on a pad also by the
sizes of the fingerprint ridges. The probe is not compared: a pad is there for all shapes.
"""

import logging
from collections.abc import Collection, Mapping
from functools import cache

from decks.presets import PRESETS, finger_table
from fembridge.errors import warn
from fembridge.trace import finger_id
from neural.parameter_sets import ParameterSet

_LOGGER = logging.getLogger(__name__)

SMOOTH = "none"
"""Ridges of a pad without any."""


def check_mechanics(
    parameters: ParameterSet, mechanics: Mapping[str, str], depths_um: Collection[float] | None
) -> str:
    """Warn of a `fit_mismatch`, and return it; "" where there is none.

    Every function and command that uses a parameter set calls this once. The arguments are those
    of `fit_mismatch`.
    """
    mismatch = fit_mismatch(parameters, mechanics, depths_um)
    if mismatch:
        warn(mismatch)
    return mismatch


def report_mechanics(
    parameters: ParameterSet, mechanics: Mapping[str, str], depths_um: Collection[float] | None
) -> None:
    """Do `check_mechanics`; where nothing differs, log the pre-indentation, if any."""
    is_same = not check_mechanics(parameters, mechanics, depths_um)
    if is_same and depths_um and parameters.preindent_um:
        _LOGGER.info(
            f"pre-indentation: {parameters.preindent_um:g} um, the depth at which the parameter "
            f"set {parameters.name} was fitted"
        )


def fit_mismatch(
    parameters: ParameterSet, mechanics: Mapping[str, str], depths_um: Collection[float] | None
) -> str:
    """Differences between the mechanics of the fit and those in use, in one line; "" for none.

    Parameters
    ----------
    parameters
        Parameter set; without mechanics of its fit only the pre-indentation is compared.
    mechanics
        ``name`` and ``sha256`` of the finger or model that gave the stress, and ``ridges`` of a
        pad; empty if unknown.
    depths_um
        Depths of the probe in um before time 0; empty if unknown; None: a press or a slide, which
        begins above the skin.
    """
    differences, fitted = [], parameters.mechanics
    if fitted:
        reference = {**_preset_id(fitted["name"]), **fitted}
        is_other = any(
            mechanics.get(key) != reference[key] for key in reference.keys() & {"name", "sha256"}
        )
        ridges = fitted.get("ridges")
        if is_other or (ridges and ridges != mechanics.get("ridges", SMOOTH)):
            differences.append(f"on {_text(fitted)} (here: {_text(mechanics, fitted, is_other)})")
    if depths_um is None:
        depths_um = {parameters.preindent_um}
    if set(depths_um) != {parameters.preindent_um} and (depths_um or parameters.preindent_um):
        depths = ", ".join(f"{depth_um:g}" for depth_um in sorted(depths_um))
        depths = f"{depths} um" if depths else "unknown"
        differences.append(
            f"at a pre-indentation of {parameters.preindent_um:g} um (here: {depths})"
        )
    if not differences:
        return ""
    return f"parameter set {parameters.name} was fitted {' and '.join(differences)}"


@cache
def _preset_id(name: str) -> Mapping[str, str]:
    """Name and digest of a preset; nothing of another name."""
    preset = PRESETS.get(name)
    return finger_id(finger_table(preset)) if preset else {}


def _text(
    mechanics: Mapping[str, str], fitted: Mapping[str, str] | None = None, is_other: bool = False
) -> str:
    """Mechanics in use, in words; what is the same as in the fit is not repeated."""
    name, ridges = mechanics.get("name"), mechanics.get("ridges")
    if name is None:
        return "unknown"
    text = f"finger {name!r}"
    if ridges:
        text = f"a pad of {text} "
        text += "with smooth skin" if ridges == SMOOTH else f"with ridges {ridges}"
    if fitted is None:
        return text
    if is_other and text == _text(fitted):
        return f"{text} with other values"
    return text
