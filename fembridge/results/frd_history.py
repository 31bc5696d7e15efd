"""Nodal values of a ``.frd`` over time: which increments count, and in what order.

Quantities are joined by (step, increment), never by position: a run that
diverged has one more DISP than STRESS, and that last one never converged.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_block import FrdBlock
from fembridge.results.frd_index import FrdIndex
from fembridge.results.frd_records import NodeRecords
from fembridge.results.read_options import ReadOptions
from fembridge.results.sta import read_sta
from fembridge.typing import FloatArray

Key = tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class NodeHistory:
    """Values ``(T, node, component)`` of each quantity, at `times_ms` ``(T,)``.

    `keys` are step and increment of each time; units are those of the file.
    """

    times_ms: FloatArray
    keys: tuple[Key, ...]
    values: Mapping[str, FloatArray]


@dataclass(frozen=True, slots=True)
class Want:
    """A quantity, the components it must have, and the nodes to read it at."""

    name: str
    components: tuple[str, ...]
    nodes: tuple[int, ...]


def read_history(
    file: ByteFile, index: FrdIndex, wants: Sequence[Want], options: ReadOptions
) -> NodeHistory:
    """Read `wants` at the increments that have all of them.

    Raises
    ------
    ResultError
        The run did not end well and `options.partial` is not set; a quantity or
        a node is not there; a value is no finite number; times do not rise.
    """
    _check_end(file, index, options)
    chosen = {want.name: _history_blocks(file, index, want) for want in wants}
    keys = _joined(file, chosen, options)
    if options.partial and not index.ended:
        keys = _converged(file, index, keys, options)
    readers = {want.name: NodeRecords(file, want.nodes) for want in wants}
    kept: list[Key] = []
    parts: dict[str, list[FloatArray]] = {want.name: [] for want in wants}
    for key in keys:
        try:
            row = [_read(file, chosen[w.name][key], w, readers[w.name]) for w in wants]
        except _NotFiniteError as error:
            if not options.partial:
                raise
            options.note(f"dropped step {key[0]}, increment {key[1]}: {error.problem}")
            continue
        kept.append(key)
        for want, values in zip(wants, row, strict=True):
            parts[want.name].append(values)
    if not kept:
        raise ResultError("no whole, converged increment is left", file.path)
    first = chosen[wants[0].name]
    times_ms = np.array([first[key].time_ms for key in kept])
    _check_times(file, kept, times_ms)
    stacked = {name: np.stack(values) for name, values in parts.items()}
    return NodeHistory(times_ms, tuple(kept), stacked)


def why_not_whole(index: FrdIndex) -> str | None:
    """Say what is wrong with a file that is not whole; None if it is."""
    if not index.blocks and not index.damage and not index.ended:
        where = "look in the .sta file and the solver's log for its reason"
        if index.nodes is None:
            return (
                f"header only ({index.size} bytes): the solver stopped before its "
                f"first output; {where}"
            )
        return f"mesh only, no results: the solver stopped at its start; {where}"
    words = [harm.problem for harm in index.damage]
    if not index.ended:
        words.append("no end line 9999: the run did not end normally")
    if not words:
        return None
    if index.blocks:
        last = index.last_whole
        words.append(
            "no whole increment"
            if last is None
            else f"last whole increment: {last.increment} of step {last.step}, "
            f"{last.time_ms:g} ms"
        )
    return "; ".join(words)


class _NotFiniteError(ResultError):
    """A NaN or an infinite value, which a partial reading may leave out."""


def _check_end(file: ByteFile, index: FrdIndex, options: ReadOptions) -> None:
    problem = why_not_whole(index)
    if problem is None:
        return
    if not options.partial or not index.blocks:
        hint = "; --partial (partial=True) reads what is whole" if index.blocks else ""
        raise ResultError(problem + hint, file.path)
    options.note(problem)


def _history_blocks(file: ByteFile, index: FrdIndex, want: Want) -> dict[Key, FrdBlock]:
    blocks = index.named(want.name)
    if not blocks:
        held = ", ".join(index.names) or "nothing"
        raise ResultError(f"no {want.name} in it, it holds {held}", file.path)
    by_key: dict[Key, FrdBlock] = {}
    for block in blocks:
        if block.modal:
            raise ResultError(f"{block} is an eigenmode, no history", file.path)
        absent = [name for name in want.components if name not in block.components]
        if absent:
            raise ResultError(
                f"{block} has no component {absent[0]}: "
                f"it holds {', '.join(block.components)}",
                file.path,
            )
        if block.key in by_key:
            raise ResultError(
                f"{block} is there twice: iterations, not increments, or two runs "
                "in one file",
                file.path,
            )
        by_key[block.key] = block
    return by_key


def _joined(
    file: ByteFile, chosen: Mapping[str, Mapping[Key, FrdBlock]], options: ReadOptions
) -> list[Key]:
    every = dict.fromkeys(key for blocks in chosen.values() for key in blocks)
    keys = [key for key in every if all(key in blocks for blocks in chosen.values())]
    for name, blocks in chosen.items():
        absent = [key for key in every if key not in blocks]
        if absent:
            step, increment = absent[0]
            words = f"step {step}, increment {increment} has no {name}"
            if not options.partial:
                raise ResultError(words, file.path)
            options.note(f"dropped: {words}")
    return keys


def _converged(
    file: ByteFile, index: FrdIndex, keys: list[Key], options: ReadOptions
) -> list[Key]:
    """Leave out the file's last increment unless something shows it converged.

    Stress is written of converged increments alone, so a STRESS block shows it;
    without one the ``.sta`` file has to.
    """
    last = index.blocks[-1].key
    if not keys or keys[-1] != last:
        return keys
    failed = _failed_attempts(file)
    has_stress = any(block.key == last for block in index.named("STRESS"))
    if failed.get(last, not has_stress):
        options.note(f"dropped step {last[0]}, increment {last[1]}: not converged")
        return keys[:-1]
    return keys


def _failed_attempts(file: ByteFile) -> dict[Key, bool]:
    """Whether the last attempt at each increment failed, from the ``.sta``."""
    path = file.path.with_suffix(".sta")
    try:
        rows = read_sta(path) if path.exists() else []
    except ResultError:
        return {}
    return {(row.step, row.increment): row.failed for row in rows}


def _read(
    file: ByteFile, block: FrdBlock, want: Want, reader: NodeRecords
) -> FloatArray:
    columns = [block.components.index(name) for name in want.components]
    values = reader.read(block)
    if columns != list(range(values.shape[1])):
        values = values[:, columns]
    if not np.isfinite(values).all():
        node, column = np.argwhere(~np.isfinite(values))[0]
        raise _NotFiniteError(
            f"node {want.nodes[node]} at {block.time_ms:g} ms: {want.name} "
            f"{want.components[column]} is {values[node, column]}",
            file.path,
        )
    return values


def _check_times(file: ByteFile, keys: Sequence[Key], times_ms: FloatArray) -> None:
    back = np.flatnonzero(~(np.diff(times_ms) > 0))
    if back.size:
        row = int(back[0]) + 1
        step, increment = keys[row]
        raise ResultError(
            f"step {step}, increment {increment} at {times_ms[row]:g} ms comes after "
            f"{times_ms[row - 1]:g} ms: times do not rise",
            file.path,
        )
