"""XML of a result file as a tree, without entities and with limited size and depth.

Nested entities expand a kilobyte to gigabytes, and an entity with a path reads another file. No
program writes results with entities; a ``<!DOCTYPE>`` that only names a DTD is common in XDMF and
is ignored.
"""

from pathlib import Path
from typing import NoReturn
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from fembridge.errors import FembridgeError, ResultError

MAX_ELEMENTS = 1_000_000
MAX_DEPTH = 64

_BUFFER_BYTES = 1 << 16


def read_xml(content: bytes, path: Path) -> Element:
    """Root element of the XML `content` of `path`; a prefix stays part of a tag.

    Raises
    ------
    ResultError
        Not XML, XML with entities, or more than `MAX_ELEMENTS` or `MAX_DEPTH`.
    """
    builder = TreeBuilder()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.buffer_size = _BUFFER_BYTES
    count = depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count, depth
        count, depth = count + 1, depth + 1
        if count > MAX_ELEMENTS:
            refuse(f"more than {MAX_ELEMENTS} XML elements")
        if depth > MAX_DEPTH:
            refuse(f"XML elements more than {MAX_DEPTH} deep")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse_entity(name: str, *_: object) -> None:
        refuse(f"XML entity {name!r}, not supported")

    def refuse(problem: str) -> NoReturn:
        raise ResultError(problem, path, parser.CurrentLineNumber)

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    parser.EntityDeclHandler = refuse_entity
    parser.SkippedEntityHandler = refuse_entity
    try:
        parser.Parse(content, True)
        return builder.close()
    except FembridgeError:
        raise
    except (expat.ExpatError, ValueError, LookupError, AssertionError) as error:
        raise ResultError(f"not XML, or cut: {error}", path) from error


def refuse_text(element: Element, path: Path) -> None:
    """Raise a `ResultError` for text between the elements in `element`, from a damaged tag."""
    for text in (element.text, *(child.tail for child in element)):
        if text and text.strip():
            problem = f"{text.strip()[:40]!r} between the elements of {element.tag}"
            raise ResultError(f"{problem}: a damaged tag", path)
