"""Pages from Jinja templates of this folder, and how a number stands in them."""

import math
from collections.abc import Callable, Mapping
from typing import Any

ABSENT = "–"


def rendered(
    template: str,
    filters: Mapping[str, Callable[..., Any]],
    **values: Any,  # noqa: ANN401 - a template takes anything
) -> str:
    """Text of a template; a name that it has not been given is an error.

    In HTML values are escaped.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("fembridge.report", "."),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=".html" in template,
    )
    environment.filters |= {"number": number, **filters}
    return environment.get_template(template).render(values)


def number(value: float, spec: str) -> str:
    """A number with a true minus, or a dash for one that does not exist."""
    if math.isnan(value):
        return ABSENT
    return format(value, spec).replace("-", "\N{MINUS SIGN}", int(value < 0))
