"""Whether a parameter set is used with the mechanics on which it was fitted."""

import logging
from collections.abc import Collection, Mapping, Sequence

from decks.presets import PRESETS, finger_table
from fembridge.errors import warn
from fembridge.stimulus import Stimulus
from fembridge.trace import finger_id
from neural.parameter_sets import ParameterSet

_LOGGER = logging.getLogger(__name__)


def fit_mismatch(
    parameters: ParameterSet, finger: Mapping[str, str], depths_um: Collection[float]
) -> str:
    """Differences between the mechanics of the fit and those in use, in one line; "" for none.

    Parameters
    ----------
    parameters
        Parameter set; without a finger of its fit only the pre-indentation is compared.
    finger
        ``name`` and ``sha256`` of the finger that gave the stress; empty if unknown.
    depths_um
        Depths of the probe in um before time 0; empty if unknown.
    """
    differences, fitted = [], parameters.finger
    if fitted:
        preset = PRESETS.get(fitted["name"])
        reference = {**(finger_id(finger_table(preset)) if preset else {}), **fitted}
        if any(finger.get(key) != reference[key] for key in reference):
            name = finger.get("name", "unknown")
            name = "one of this name with other values" if name == fitted["name"] else name
            differences.append(f"on finger {fitted['name']!r} (here: {name})")
    if set(depths_um) != {parameters.preindent_um} and (depths_um or parameters.preindent_um):
        depths = ", ".join(f"{depth_um:g}" for depth_um in sorted(depths_um))
        depths = f"{depths} um" if depths else "unknown"
        differences.append(
            f"at a pre-indentation of {parameters.preindent_um:g} um (here: {depths})"
        )
    if not differences:
        return ""
    return f"parameter set {parameters.name} was fitted {' and '.join(differences)}"


def report_mechanics(
    parameters: ParameterSet, finger: Mapping[str, str], stimuli: Sequence[Stimulus]
) -> None:
    """Warn of a `fit_mismatch`; otherwise log the pre-indentation of `stimuli`, if any."""
    if mismatch := fit_mismatch(
        parameters, finger, {stimulus.preindent_um for stimulus in stimuli}
    ):
        warn(mismatch)
    elif parameters.preindent_um:
        _LOGGER.info(
            f"pre-indentation: {parameters.preindent_um:g} um, the depth at which the parameter "
            f"set {parameters.name} was fitted"
        )
