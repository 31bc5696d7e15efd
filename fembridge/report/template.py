"""Pages from Jinja templates of this folder."""

from collections.abc import Callable, Mapping
from typing import Any

from fembridge.words import number, worded


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
    environment.filters |= {"number": number, "worded": worded, **filters}
    return environment.get_template(template).render(values)
