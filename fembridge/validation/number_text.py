"""Numbers as a page shows them: as many digits as they bear, and what is absent."""

import math

ABSENT = "–"
_LEAST_P = 0.001
_MINUS = "\N{MINUS SIGN}"


def share_text(value: float) -> str:
    """Give R² or a vector strength: two decimals."""
    return ABSENT if math.isnan(value) else f"{value:.2f}"


def p_text(value: float) -> str:
    """Give a p value: three decimals, or that it is below them."""
    if math.isnan(value):
        return ABSENT
    return "<0.001" if value < _LEAST_P else f"{value:.3f}"


def rate_text(value: float) -> str:
    """Give a rate in impulses a second: one decimal."""
    return ABSENT if math.isnan(value) else f"{value:.1f}"


def signed_text(value: float) -> str:
    """Give a bias: one decimal and its sign."""
    if math.isnan(value):
        return ABSENT
    rounded = round(value, 1)
    return f"{rounded:+.1f}".replace("-", _MINUS) if rounded else "0.0"


def amplitude_text(value_um: float) -> str:
    """Give an amplitude in um: three digits that count."""
    return f"{value_um:#.3g}".removesuffix(".")


def digits_text(value: float, digits: int) -> str:
    """Give a number with so many digits after the point, or that there is none."""
    return ABSENT if math.isnan(value) else f"{value:.{digits}f}".replace("-", _MINUS)
