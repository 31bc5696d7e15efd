"""Formatted numbers, tables and pages, in HTML and in Markdown."""

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pandas import DataFrame

ABSENT = "–"
# Unit suffixes of names, longer ones first.
_UNITS = {
    "_mpa_per_mm": "MPa/mm",
    "_mm_per_s": "mm/s",
    "_n_per_mm": "N/mm",
    "_kg_m3": "kg/m³",
    "_percent": "%",
    "_kpa": "kPa",
    "_pa": "Pa",
    "_mpa": "MPa",
    "_deg": "°",
    "_mm": "mm",
    "_um": "µm",
    "_ips": "ips",
    "_ms": "ms",
    "_s": "s",
}


def split_unit(name: str) -> tuple[str, str]:
    """A name without its unit suffix, and the unit: ``depth_um`` is ``depth`` in ``µm``."""
    suffix = next((suffix for suffix in _UNITS if name.endswith(suffix)), "")
    return name.removesuffix(suffix), _UNITS.get(suffix, "")


def number(value: float, spec: str) -> str:
    """A number with a minus sign (U+2212), 0 without a sign, NaN as a dash."""
    if math.isnan(value):
        return ABSENT
    text = format(value, spec)
    if text[0] in "+-" and not float(text):
        text = text[1:]
    return text.replace("-", "\N{MINUS SIGN}", int(value < 0))


def worded(frame: "DataFrame", formats: str) -> "DataFrame":
    """`frame` as strings; `formats` has a format spec for each column, separated by ``|``."""
    columns = zip(frame.columns, formats.split("|"), strict=True)
    return frame.astype(object).assign(
        **{
            name: [cell if isinstance(cell, str) else number(cell, spec) for cell in frame[name]]
            for name, spec in columns
        }
    )


def markdown(frame: "DataFrame") -> str:
    """A Markdown table of a frame of strings, without its index."""
    head, *body = (f"| {' | '.join(line)} |" for line in [[*frame], *frame.itertuples(index=False)])
    return "\n".join([head, "|" + "---|" * frame.shape[1], *body])


def rendered(
    template: str,
    filters: Mapping[str, Callable[..., Any]],
    **values: Any,  # noqa: ANN401 - a template takes anything
) -> str:
    """Text of a template of `fembridge.reporting`; a missing value is an error.

    Values are escaped in HTML.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("fembridge.reporting", "."),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=".html" in template,
    )
    environment.filters |= {"number": number, "worded": worded, **filters}
    return environment.get_template(template).render(values)
