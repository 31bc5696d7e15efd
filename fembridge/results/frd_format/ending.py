"""How a ``.frd`` ended: what is wrong with a file that is not whole, in words."""

from pathlib import Path

from fembridge.errors import ResultError
from fembridge.results.frd_format.index import FrdIndex
from fembridge.results.printed.sta import StaRow, read_sta

Key = tuple[int, int]
_WORDS_AT_MOST = 3


def why_not_whole(index: FrdIndex, path: Path | None = None) -> str | None:
    """Say what is wrong with a file that is not whole; None if it is.

    With the file's `path` the ``.sta`` beside it tells of an increment that did
    not converge.
    """
    if not index.blocks and not index.damage and not index.ended:
        return _nothing(index)
    words = [harm.problem for harm in index.damage]
    if len(words) > _WORDS_AT_MOST:
        words[_WORDS_AT_MOST:] = [f"and {len(words) - _WORDS_AT_MOST} places more"]
    if not index.ended:
        words.append("no end line 9999: the run did not end normally")
        words.extend(_unconverged(index, path))
    if not words:
        return None
    if index.blocks:
        last = index.last_whole
        words.append(
            "no whole increment"
            if last is None
            else f"last whole increment: {last.increment} of step {last.step}, {last.time_ms:g} ms"
        )
    return "; ".join(words)


def failed_attempts(path: Path) -> dict[Key, bool]:
    """Whether the last attempt at each increment failed: from the ``.sta`` beside."""
    return {(row.step, row.increment): row.failed for row in _attempts(path)}


def _nothing(index: FrdIndex) -> str:
    where = "look in the .sta file and the solver's log for its reason"
    if index.nodes is None:
        return (
            f"header only ({index.size} bytes): the solver stopped before its first output; {where}"
        )
    return f"mesh only, no results: the solver stopped at its start; {where}"


def _unconverged(index: FrdIndex, path: Path | None) -> list[str]:
    rows = [] if path is None else _attempts(path)
    if rows and rows[-1].failed:
        last = rows[-1]
        return [
            f"increment {last.increment} of step {last.step} did not converge "
            f"(.sta: attempt {last.attempt} failed)"
        ]
    block = index.unconverged
    if block is None:
        return []
    held = dict.fromkeys(b.name for b in index.blocks if b.key == block.key)
    before = index.last_whole
    names = {b.name for b in index.blocks if before and b.key == before.key}
    absent = sorted(names - held.keys())
    return [
        f"increment {block.increment} of step {block.step} has {', '.join(held)} and "
        f"no {', '.join(absent)}: it did not converge"
    ]


def _attempts(path: Path) -> list[StaRow]:
    beside = path.with_suffix(".sta")
    try:
        return read_sta(beside) if beside.exists() else []
    except (ResultError, OSError):
        return []
