"""Parts, instances and the assembly of a deck of Abaqus, and the flat deck that they stand for.

A node's number and the name of a set count in their part alone; an instance puts its part into the
assembly, shifted and then rotated; the assembly names both as ``INSTANCE.NAME``. `flat_deck` writes
the same model without parts, in global coordinates: with one numbering, in which the first instance
keeps its numbers and others add a power of ten where numbers meet, and with one set of names, in
which a name of one instance alone stays and others become ``INSTANCE_NAME``.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from decks.inp import Block, Deck, Option, block_text, normalized_name, read_inp
from fembridge.typing import FloatArray

_SCOPE_KEYWORDS = ("PART", "INSTANCE")
_LABELLED = {"NSET": "NSET", "NODE": "NSET", "ELSET": "ELSET", "ELEMENT": "ELSET"}
# Options whose value is a name of the part; cards of a part with no numbers in their data.
_NAMES = ("NSET", "ELSET", "NAME", "ORIENTATION")
_WITHOUT_NUMBERS = ("MASS", "ROTARYINERTIA", "SPRING", "DASHPOT")
_DROPPED_OPTIONS = ("INPUT", "INSTANCE", "INTERNAL")
FLAT_FILE = "base.inp"
"""Name of the file that a flat deck is written to."""
_AXES = 3
_ROTATION_FIELDS = 7


@dataclass(frozen=True, slots=True)
class Placement:
    """Where an instance puts its part: a shift, then a rotation about a line from start to stop.

    Lengths are in the deck's unit; the angle is counter-clockwise as seen against the line.
    """

    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    start: tuple[float, float, float] = (0.0, 0.0, 0.0)
    stop: tuple[float, float, float] = (0.0, 0.0, 1.0)
    angle_deg: float = 0.0

    @property
    def is_identity(self) -> bool:
        """Whether the part stays where it is."""
        return not (any(self.shift) or self.angle_deg)

    @property
    def rotation(self) -> FloatArray:
        """Rotation of vectors, ``(3, 3)``, by the formula of Rodrigues."""
        axis = np.subtract(self.stop, self.start)
        axis = axis / np.linalg.norm(axis)
        cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
        angle = np.radians(self.angle_deg)
        matrix: FloatArray = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        return matrix

    def moved(self, position: FloatArray) -> FloatArray:
        """Positions ``(N, 3)`` of the part, in the assembly."""
        if self.is_identity:
            return position
        shifted = position + np.array(self.shift)
        if not self.angle_deg:
            return np.asarray(shifted)
        moved: FloatArray = (shifted - np.array(self.start)) @ self.rotation.T + self.start
        return moved


@dataclass(frozen=True, slots=True, eq=False)
class Scope:
    """Blocks whose numbers count together: a part as an instance puts it, or all others."""

    instance: str
    blocks: tuple[Block, ...]
    placement: Placement = Placement()


def scopes_of(deck: Deck) -> list[Scope]:
    """The scopes of a deck: one, or the assembly's own and one an instance.

    Raises
    ------
    DeckError
        A part or an instance without its end, or an instance of no part, with its line.
    """
    parts: dict[str, list[Block]] = {}
    scopes: list[Scope] = []
    outside: list[Block] = []
    inside: list[Block] = []
    opened: Block | None = None
    for block in deck.blocks:
        if opened is not None and block.keyword in (*_SCOPE_KEYWORDS, "ENDASSEMBLY", "STEP"):
            raise opened.error(f"this {opened.title} has no *END {opened.title[1:]}")
        if block.keyword in _SCOPE_KEYWORDS:
            opened, inside = block, []
        elif opened is not None and block.keyword == f"END{opened.keyword}":
            if opened.keyword == "PART":
                parts[opened.value_of("NAME")] = inside
            else:
                scopes.append(_instance(opened, parts, inside))
            opened = None
        else:
            (outside if opened is None else inside).append(block)
    return [Scope("", tuple(outside)), *scopes]


def _instance(block: Block, parts: dict[str, list[Block]], instance_blocks: list[Block]) -> Scope:
    part = block.value_of("PART")
    if part and part not in parts:
        raise block.error(f"*INSTANCE of part {part}, which is nowhere before it")
    option = block.option("NAME")
    if option is None:
        raise block.error(f"{block.title} without NAME=")
    # With its case and quotes, which Abaqus heeds together.
    name_text = block.text.data[option.start : option.stop].partition(b"=")[2]
    name = name_text.strip().decode("latin-1")
    return Scope(name, (*parts.get(part, ()), *instance_blocks), _placement(block))


def _placement(block: Block) -> Placement:
    rows = list(block.rows())
    numbers = [[row.number(k, blank=0.0) for k in range(_ROTATION_FIELDS)] for row in rows[:2]]
    x, y, z = numbers[0][:_AXES] if numbers else (0.0, 0.0, 0.0)
    if len(numbers) < 2:
        return Placement((x, y, z))
    a, b, c, d, e, f, angle_deg = numbers[1]
    if angle_deg and (a, b, c) == (d, e, f):
        raise block.error("the two points of its axis of rotation are the same")
    return Placement((x, y, z), (a, b, c), (d, e, f), angle_deg)


# ---- The flat deck


@dataclass(frozen=True, slots=True, eq=False)
class FlatDeck:
    """A deck without parts: its text, names ``INSTANCE.NAME`` in it, and what was renumbered."""

    data: bytes
    names: Mapping[str, str]
    remarks: tuple[str, ...]

    def read(self, *, renamed: bool = True) -> Deck:
        """The deck; if `renamed`, its lines in an error are those of ``base.inp``."""
        return read_inp(self.data, abaqus=True, name=FLAT_FILE if renamed else "")

    def name(self, text: str) -> str:
        """The name of a set or surface in the flat deck, of ``NAME`` or ``INSTANCE.NAME``."""
        return self.names.get(normalized_name(text), text)


def has_parts(deck: Deck) -> bool:
    """Whether a deck has parts or instances."""
    return bool(deck.blocks_of(*_SCOPE_KEYWORDS))


def flat_deck(deck: Deck) -> FlatDeck:
    """A deck of parts and instances as one without; included files are part of its text.

    Raises
    ------
    DeckError
        A card in a part that is not known to hold in a flat deck, with its line.
    """
    outside, *instances = scopes_of(deck)
    flattener = _Flattener(outside, instances)
    return FlatDeck(b"".join(flattener.lines()), flattener.full_names, tuple(flattener.remarks))


class _Flattener:
    """Numbers and names of all scopes, and the text of their blocks."""

    def __init__(self, outside: Scope, instances: list[Scope]) -> None:
        self._outside = outside
        self._instances = {normalized_name(scope.instance): scope for scope in instances}
        self.remarks: list[str] = []
        self._offset: dict[str, int] = {"": 0}
        used = {kind: set(_numbers(outside.blocks, kind)) for kind in ("NODE", "ELEMENT")}
        of_instance = {
            name: {kind: set(_numbers(scope.blocks, kind)) for kind in used}
            for name, scope in self._instances.items()
        }
        largest = max(
            max(numbers, default=0)
            for sets in (used, *of_instance.values())
            for numbers in sets.values()
        )
        step = 10 ** len(str(largest))
        for number, (name, sets) in enumerate(of_instance.items()):
            meets = any(used[kind] & sets[kind] for kind in used)
            self._offset[name] = step * number if meets else 0
            if meets:
                self.remarks.append(
                    f"instance {name}: {step * number} is added to its nodes and elements"
                )
            for kind in used:
                used[kind] |= {value + self._offset[name] for value in sets[kind]}
        self._names = {name: set(_defined(s.blocks)) for name, s in self._instances.items()}
        all_names = [
            *_defined(outside.blocks),
            *(n for names in self._names.values() for n in names),
        ]
        self._single = {name for name in all_names if all_names.count(name) == 1}
        self.full_names = {
            f"{instance}.{name}": self._flat_name(instance, name)
            for instance, names in self._names.items()
            for name in names
        }
        self._qualified = re.compile(
            "|".join(re.escape(f"{name}.") for name in sorted(self._instances, key=len)[::-1])
        )

    def _flat_name(self, instance: str, name: str) -> str:
        if not instance or name not in self._names[instance] or name in self._single:
            return name
        return f"{instance}_{name}"

    def lines(self) -> Iterator[bytes]:
        """The text of the flat deck."""
        blocks = list(self._outside.blocks)
        first = next((n for n, b in enumerate(blocks) if b.keyword == "ASSEMBLY"), 0)
        yield from map(self._outer_text, blocks[:first])
        later: list[bytes] = []
        for name, scope in self._instances.items():
            for block in scope.blocks:
                # CalculiX needs a material before its section.
                is_late = block.keyword.endswith("SECTION")
                text = self._inner_text(block, name, scope.placement)
                if is_late:
                    later.append(text)
                else:
                    yield text
        for block in blocks[first:]:
            if block.keyword in ("ASSEMBLY", "ENDASSEMBLY"):
                continue
            if block.keyword == "STEP":
                yield from later
                later = []
            yield self._outer_text(block)
        yield from later

    def _inner_text(self, block: Block, instance: str, placement: Placement) -> bytes:
        """A block of a part, as `instance` puts it."""
        keyword = block.keyword
        if keyword == "NODE":
            if block.value_of("SYSTEM") not in ("", "R"):
                raise block.error(f"*NODE, SYSTEM={block.value_of('SYSTEM')}: expected R")
            return self._head(block, instance) + self._nodes(block, instance, placement)
        if keyword in ("ELEMENT", "NSET", "ELSET", "SURFACE"):
            if block.option("COMBINE") is not None:
                raise block.error("*SURFACE, COMBINE in a part: expected elements or nodes")
            return self._head(block, instance) + self._labels(block, instance)
        if keyword == "ORIENTATION" and not placement.is_identity:
            raise block.error(f"*ORIENTATION of the part of {instance}, which is moved")
        if keyword in _WITHOUT_NUMBERS or keyword.endswith("SECTION") or keyword == "ORIENTATION":
            data = b"".join(piece.text.data[piece.start : piece.stop] for piece in block.pieces)
            return self._head(block, instance) + _with_line_end(data)
        raise block.error(f"{block.title} in a part is not read; write a flat input file")

    def _head(self, block: Block, instance: str) -> bytes:
        """The keyword line with flat names."""
        head = [block.title]
        for option in block.options:
            if option.name in _DROPPED_OPTIONS:
                continue
            text = block.text.data[option.start : option.stop].decode("latin-1").strip()
            if option.name in _NAMES:
                text = f"{option.name}={self._flat_name(instance, option.normalized)}"
            head.append(text)
        return (", ".join(head) + "\n").encode("latin-1")

    def _nodes(self, block: Block, instance: str, placement: Placement) -> bytes:
        rows = list(block.rows())
        position = np.array(
            [[row.number(1 + axis, blank=0.0) for axis in range(_AXES)] for row in rows]
        ).reshape(-1, _AXES)
        offset = self._offset[instance]
        lines = [
            f"{row.integer(0) + offset}, {x!r}, {y!r}, {z!r}\n"
            for row, (x, y, z) in zip(rows, placement.moved(position).tolist(), strict=True)
        ]
        return "".join(lines).encode()

    def _labels(self, block: Block, instance: str) -> bytes:
        """Data lines of numbers and names; of a surface the first field alone is one."""
        is_generated, lines = block.option("GENERATE") is not None, []
        is_surface = block.keyword == "SURFACE"
        for row in block.rows():
            count = 1 if is_surface else 2 if is_generated else len(row.fields)
            labels = [self._label(text, instance) for text in row.fields[:count]]
            lines.append(", ".join([*labels, *row.fields[count:]]) + "\n")
        return "".join(lines).encode("latin-1")

    def _label(self, text: str, instance: str) -> str:
        """A number or a name in the flat deck; `text` may be qualified by an instance."""
        packed = normalized_name(text)
        if match := self._qualified.match(packed):
            return self._label(packed[match.end() :], match[0][:-1])
        if packed.isdigit():
            return str(int(packed) + self._offset[instance])
        return self._flat_name(instance, packed) if instance else text

    def _outer_text(self, block: Block) -> bytes:
        """A block of the assembly, of the model or of a step."""
        instance = normalized_name(block.value_of("INSTANCE"))
        if block.keyword in _LABELLED and instance:
            if instance not in self._instances:
                raise block.error(f"*INSTANCE {instance} is nowhere in the deck")
            return self._head(block, "") + self._labels(block, instance)
        text = block_text(block)
        if not self._mentions_instance(text):
            return text
        head = [block.title]
        for option in block.options:
            head.append(self._outer_option(block, option))
        lines = [", ".join(head)]
        for row in block.rows():
            lines.append(", ".join(self._outer_field(text) for text in row.fields))
        return ("\n".join(lines) + "\n").encode("latin-1")

    def _mentions_instance(self, text: bytes) -> bool:
        return bool(
            self._instances and self._qualified.search(normalized_name(text.decode("latin-1")))
        )

    def _outer_option(self, block: Block, option: Option) -> str:
        text = block.text.data[option.start : option.stop].decode("latin-1").strip()
        name, sign, _ = text.partition("=")
        return f"{name}={self._outer_field(option.value or '')}" if sign else text

    def _outer_field(self, text: str) -> str:
        return self._label(text, "") if self._qualified.match(normalized_name(text)) else text


def _numbers(blocks: Iterable[Block], keyword: str) -> Iterator[int]:
    """Numbers of the nodes or elements that blocks define."""
    for block in blocks:
        if block.keyword != keyword:
            continue
        goes_on = False
        for row in block.rows():
            if not goes_on:
                yield row.integer(0)
            goes_on = keyword == "ELEMENT" and not row.fields[-1]


def _defined(blocks: Iterable[Block]) -> set[str]:
    """Names of sets, surfaces and orientations that blocks define."""
    names = set()
    for block in blocks:
        option = _LABELLED.get(block.keyword)
        option = "NAME" if block.keyword in ("SURFACE", "ORIENTATION") else option
        if option and (name := block.value_of(option)):
            names.add(name)
    return names


def _with_line_end(data: bytes) -> bytes:
    return data + (b"" if not data or data.endswith(b"\n") else b"\n")
