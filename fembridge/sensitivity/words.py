"""Parameters, values and groups of stimuli in words that fit a table or a picture."""

import math
import re

from fembridge.sensitivity.swept import ALL, RATE, STRESS

_MINUS = "\N{MINUS SIGN}"
_LAYERS = {
    "stratum_corneum": "stratum corneum",
    "epidermis": "epidermis",
    "dermis": "dermis",
    "subcutaneous_tissue": "subcutaneous tissue",
    "bone": "bone",
    "nail": "nail",
}
_PLAIN = {
    "ridges.height_mm": "ridge height",
    "ridges.spacing_mm": "ridge spacing",
    "papillae.height_mm": "papilla height",
    "contact.friction": "friction",
    "contact_friction": "friction",
    "probe_diameter_mm": "probe diameter",
    "probe_x_mm": "probe aside",
    "preindent_um": "pre-indentation",
}
_MADE = (
    (re.compile(r"skin\.(\w+)_mm"), "{} thickness"),
    (re.compile(r"materials\.(\w+)\.young_mpa"), "{} modulus"),
    (re.compile(r"materials\.(\w+)\.poisson"), "{} Poisson’s ratio"),
    (re.compile(r"afferents\.(\w+)\.to_boundary_mm"), "{} to boundary"),
    (re.compile(r"afferents\.(\w+)\.depth_mm"), "{} depth"),
)
_UNITS = {"_mm": "mm", "_mpa": "MPa", "_um": "µm", "_deg": "°"}


def parameter_words(name: str) -> str:
    """Name a parameter as people do: ``dermis modulus``; others keep their name."""
    if name in _PLAIN:
        return _PLAIN[name]
    for pattern, words in _MADE:
        if (match := pattern.fullmatch(name)) is not None:
            return words.format(_LAYERS.get(match[1], match[1]))
    return name


def unit_of(name: str) -> str:
    """Give the unit that a parameter's name ends in, or nothing."""
    return next((unit for end, unit in _UNITS.items() if name.endswith(end)), "")


def group_words(group: str) -> str:
    """Name a group of stimuli: ``20 Hz``, ``diharmonic``."""
    family, _, frequency_hz = group.partition("_")
    if family == "sine" and frequency_hz:
        return f"{frequency_hz} Hz"
    return {"diharm": "diharmonic", ALL: "all"}.get(group, group)


def quantity_words(quantity: str) -> str:
    """Name a quantity with the unit that `shown` gives it."""
    return {RATE: "rate (impulses/s)", STRESS: "peak stress (kPa)"}[quantity]


def shown(quantity: str, number: float) -> float:
    """Turn an answer into the unit that it is shown in."""
    return number / 1000 if quantity == STRESS else number


def signed(number: float, digits: int) -> str:
    """Give a number with its sign; what rounds to nothing has none."""
    if math.isnan(number):
        return "–"
    text = f"{number:+.{digits}f}"
    return text.replace("-", _MINUS) if float(text) else f"{0:.{digits}f}"
