"""Nodal values of a ``.frd`` over time: which increments count, and in what order.

Quantities are joined by (step, increment), never by position: a run that
diverged has one more DISP than STRESS, and that last one never converged.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.block import FrdBlock
from fembridge.results.frd_format.ending import failed_attempts, why_not_whole
from fembridge.results.frd_format.index import FrdIndex
from fembridge.results.frd_format.records import NodeRecords
from fembridge.results.read_options import ReadOptions
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
    chosen = {want.name: _history_blocks(file, index, want, options) for want in wants}
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
    _check_unchanged(file, options)
    stacked = {name: np.stack(values) for name, values in parts.items()}
    return NodeHistory(times_ms, tuple(kept), stacked)


class _NotFiniteError(ResultError):
    """A NaN or an infinite value, which a partial reading may leave out."""


def _check_end(file: ByteFile, index: FrdIndex, options: ReadOptions) -> None:
    for remark in index.remarks:
        options.note(remark)
    problem = why_not_whole(index, file.path)
    if problem is None:
        return
    if index.remarks:
        problem = "; ".join([*index.remarks, problem])
    if file.change is not None:
        problem = f"{file.change}; {problem}"
    if not options.partial or not index.blocks:
        hint = "; --partial (partial=True) reads what is whole" if index.blocks else ""
        raise ResultError(problem + hint, file.path)
    options.note(problem)


def _check_unchanged(file: ByteFile, options: ReadOptions) -> None:
    change = file.change
    if change is None:
        return
    if not options.partial:
        raise ResultError(f"{change}; read it again when the run has ended", file.path)
    options.note(change)


def _history_blocks(
    file: ByteFile, index: FrdIndex, want: Want, options: ReadOptions
) -> dict[Key, FrdBlock]:
    blocks = index.named(want.name)
    if not blocks:
        held = ", ".join(index.names) or "nothing"
        raise ResultError(f"no {want.name} in it, it holds {held}", file.path)
    by_key: dict[Key, FrdBlock] = {}
    for block in _over_time(file, index, want.name, blocks, options):
        absent = [name for name in want.components if name not in block.components]
        if absent:
            raise ResultError(
                f"{block} has no component {absent[0]}: it holds {', '.join(block.components)}",
                file.path,
            )
        if block.key in by_key:
            raise ResultError(
                f"{block} is there twice: iterations, not increments, or two runs in one file",
                file.path,
            )
        by_key[block.key] = block
    return by_key


def _over_time(
    file: ByteFile, index: FrdIndex, name: str, blocks: Sequence[FrdBlock], options: ReadOptions
) -> list[FrdBlock]:
    """Take the blocks of static and dynamic steps: modes have no time."""
    found = [block for block in blocks if block.output.over_time]
    others = [block for block in blocks if not block.output.over_time]
    if others:
        first, last = others[0].output, others[-1].output
        what = "results of another kind than static or dynamic"
        if first.modal:
            what = f"{len(others)} modes ({first.axis} {first.value:g}"
            what += f" to {last.value:g})" if last.value != first.value else ")"
        words = f"{name} of step {others[0].step} holds {what}, no history over time"
        if not found:
            raise ResultError(f"{words}: there is no trace to take", file.path)
        options.note(f"left out: {words}")
    imaginary = {block.key for block in index.named(f"{name}I")}
    if any(block.key in imaginary for block in found):
        raise ResultError(
            f"{name} has an imaginary part, {name}I: amplitudes over frequency, no "
            "history over time; there is no trace to take",
            file.path,
        )
    return found


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


def _converged(file: ByteFile, index: FrdIndex, keys: list[Key], options: ReadOptions) -> list[Key]:
    """Leave out the file's last increment unless something shows it converged.

    Stress is written of converged increments alone, so a STRESS block shows it;
    without one the ``.sta`` file has to.
    """
    last = index.blocks[-1].key
    if not keys or keys[-1] != last:
        return keys
    failed = failed_attempts(file.path)
    has_stress = any(block.key == last for block in index.named("STRESS"))
    if failed.get(last, not has_stress):
        options.note(f"dropped step {last[0]}, increment {last[1]}: not converged")
        return keys[:-1]
    return keys


def _read(file: ByteFile, block: FrdBlock, want: Want, reader: NodeRecords) -> FloatArray:
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
