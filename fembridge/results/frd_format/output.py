"""Which outputs of a ``.frd`` count, and the blocks of each.

An output is what CalculiX writes at one increment (or of one mode): blocks with
the same step and increment that follow each other. A run that did not end well
may close with an output that never converged.
"""

from collections.abc import Sequence

from fembridge.errors import ResultError
from fembridge.results.byte_file import ByteFile
from fembridge.results.frd_format.block import FrdBlock
from fembridge.results.frd_format.ending import failed_attempts, why_not_whole
from fembridge.results.frd_format.index import FrdIndex
from fembridge.results.read_options import ReadOptions

Output = dict[str, FrdBlock]  # by quantity


def outputs_of(file: ByteFile, index: FrdIndex, options: ReadOptions) -> tuple[Output, ...]:
    """Give the blocks of each output that counts, in file order.

    Raises
    ------
    ResultError
        The run did not end well and `options.partial` is not set, or the file
        holds no results.
    """
    for remark in index.remarks:
        options.note(remark)
    problem = why_not_whole(index, file.path)
    if not index.blocks:
        raise ResultError(problem or "no results in it", file.path)
    if problem is not None and not options.partial:
        raise ResultError(f"{problem}; --partial (partial=True) reads what is whole", file.path)
    if problem is not None:
        options.note(problem)
    outputs: list[Output] = []
    for block in index.blocks:
        current = outputs[-1] if outputs else {}
        if block.name in current or {b.key for b in current.values()} != {block.key}:
            outputs.append({})
        outputs[-1][block.name] = block
    if not index.ended:
        outputs = _converged(file, outputs, options)
    if not outputs:
        raise ResultError("no whole, converged increment is left", file.path)
    return tuple(outputs)


def having(
    file: ByteFile, outputs: Sequence[Output], names: Sequence[str], options: ReadOptions
) -> list[Output]:
    """Give the outputs that have all quantities `names`, and these alone.

    Raises
    ------
    ResultError
        No output has one of them; or one has some and not all, and
        `options.partial` is not set.
    """
    held = dict.fromkeys(name for output in outputs for name in output)
    for name in names:
        if name not in held:
            raise ResultError(f"no {name} in it, it holds {', '.join(held)}", file.path)
    found = []
    for output in outputs:
        absent = [name for name in names if name not in output]
        if not absent:
            found.append({name: output[name] for name in names})
        elif len(absent) < len(names):
            step, increment = next(iter(output.values())).key
            words = f"step {step}, increment {increment} has no {absent[0]}"
            if not options.partial:
                raise ResultError(words, file.path)
            options.note(f"dropped: {words}")
    if not found:
        raise ResultError(f"no increment has all of {', '.join(names)}", file.path)
    return found


def _converged(file: ByteFile, outputs: list[Output], options: ReadOptions) -> list[Output]:
    """Leave out the last output unless something shows that it converged.

    Stress is written of converged increments alone, so a STRESS block shows it;
    without one the ``.sta`` file has to.
    """
    last = outputs[-1]
    key = next(iter(last.values())).key
    if not failed_attempts(file.path).get(key, "STRESS" not in last):
        return outputs
    options.note(f"dropped step {key[0]}, increment {key[1]}: not converged")
    return outputs[:-1]
