"""Parameters of public functions, classes and methods are documented: unit, shape and default."""

import inspect
import re
from dataclasses import is_dataclass
from typing import NamedTuple

import pytest

import decks.finger
import fembridge as fb
from fembridge.io.run_folder import RunFolder
from fembridge.solver.verdict import Outcome
from neural import ParameterSet

FURTHER_CLASSES = [
    *(decks.finger.Outline, decks.finger.Skin, decks.finger.Ridges, decks.finger.Papillae),
    *(decks.finger.Bone, decks.finger.Nail, decks.finger.Material, decks.finger.PronyTerm),
    *(decks.finger.AfferentSite, decks.finger.Resolution, RunFolder, Outcome, ParameterSet),
]
"""Parts of a finger, and what public functions take or return."""

UNITS = {
    "um": "um",
    "mm": "mm",
    "ms": "ms",
    "s": "s",
    "hz": "Hz",
    "pa": "Pa",
    "mpa": "MPa",
    "deg": "deg",
    "percent": "percent",
    "ips": "impulses/s",
}
"""Unit in a description by the end of a parameter's name."""

_ENTRY = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: : .*)?$")


class Parameter(NamedTuple):
    """A parameter of a public function, class or method, and its description or None."""

    of: str
    name: str
    annotation: str
    has_default: bool
    description: str | None


def sections(docstring):
    """Entries ``{section: {name: description}}`` of a numpydoc docstring."""
    lines = inspect.cleandoc(docstring or "").splitlines()
    found, entries, names = {}, {}, []
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        if following and set(following) == {"-"} and len(following) == len(line):
            entries = found.setdefault(line, {})
            names = []
        elif line and not line.startswith(" ") and (match := _ENTRY.match(line)):
            names = [name.lstrip("*") for name in match[1].split(", ")]
            entries |= dict.fromkeys(names, "")
        elif line.startswith(" "):
            for name in names:
                entries[name] += line.strip() + " "
    return found


def parameters_of(name, function, docstring):
    described = sections(docstring).get("Parameters", {})
    for parameter in inspect.signature(function).parameters.values():
        if parameter.name not in ("self", "cls"):
            yield Parameter(
                name,
                parameter.name,
                str(parameter.annotation),
                parameter.default is not parameter.empty,
                described.get(parameter.name),
            )


def is_ours(thing):
    return (getattr(thing, "__module__", None) or "").split(".")[0] in (
        "fembridge",
        "decks",
        "neural",
    )


def documented_things():
    """Name, callable and docstring of each public function, class and public method."""
    public = {name: getattr(fb, name) for name in sorted(fb._HOMES)}
    public |= {part.__name__: part for part in FURTHER_CLASSES}
    for name, thing in public.items():
        if not inspect.isclass(thing):
            yield name, thing, thing.__doc__
            continue
        if is_dataclass(thing) or is_ours(thing.__init__):
            yield name, thing, thing.__doc__
        for attribute in dir(thing):
            method = inspect.getattr_static(thing, attribute)
            method = getattr(method, "__func__", method)
            if not attribute.startswith("_") and inspect.isfunction(method) and is_ours(method):
                yield f"{name}.{attribute}", method, method.__doc__


THINGS = {name: (function, docstring) for name, function, docstring in documented_things()}
PARAMETERS = [
    parameter
    for name, (function, docstring) in THINGS.items()
    for parameter in parameters_of(name, function, docstring)
]


def names_of(parameters):
    return [f"{parameter.of}: {parameter.name}" for parameter in parameters]


def test_each_parameter_is_documented():
    assert len(PARAMETERS) > 150
    assert not names_of(item for item in PARAMETERS if not item.description)


def test_each_default_is_documented():
    described = [item for item in PARAMETERS if item.description and item.has_default]
    assert not names_of(item for item in described if "efault" not in item.description)


def test_each_unit_is_documented():
    missing = []
    for item in PARAMETERS:
        unit = UNITS.get(item.name.rpartition("_")[2]) if "_" in item.name else None
        if unit and not re.search(rf"\b{unit}\b", item.description or ""):
            missing.append(item)
    assert not names_of(missing)


def test_each_array_has_a_documented_shape():
    arrays = [
        item for item in PARAMETERS if re.search("FloatArray|IntArray|ndarray", item.annotation)
    ]
    assert arrays
    assert not names_of(item for item in arrays if "``(" not in (item.description or ""))


@pytest.mark.parametrize("name", THINGS)
def test_nothing_is_documented_that_is_no_parameter(name):
    function, docstring = THINGS[name]
    known = set(inspect.signature(function).parameters)
    assert set(sections(docstring).get("Parameters", {})) <= known


@pytest.mark.parametrize("name", THINGS)
def test_each_public_name_has_a_summary(name):
    _, docstring = THINGS[name]
    summary = inspect.cleandoc(docstring or "").split("\n\n")[0]
    assert summary.endswith((".", ":"))
    assert not summary.startswith(f"{name}(")  # made by dataclasses
