"""The verbs of the command line, one module each: glue, no logic of their own.

A verb computes, writes its files, prints what people read, and ends in the files' names;
all of them write and name files in the same way.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

Content: TypeAlias = "str | DataFrame | Figure | Callable[[Path], object]"
"""What is in a file: a text, a table, a picture, or what writes it to a path."""


def write_files(folder: Path, files: Mapping[str, Content], last: str = "") -> None:
    """Write `files` into `folder`, all or none; before a verb prints, as nobody may read that.

    The `last` of them takes its place last, see `fembridge.host.store.filling`.
    """
    from fembridge.host.store import filling, write_text
    from fembridge.plots.style import save_figure

    with filling(folder, last=last or list(files)[-1]) as draft:
        for name, content in files.items():
            if callable(content):
                content(draft / name)
            elif isinstance(content, str):
                write_text(draft / name, content)
            elif hasattr(content, "to_csv"):
                write_text(draft / name, content.to_csv(index=False))
            else:
                save_figure(content, draft / name)


def written(folder: Path, files: Sequence[str], others: Sequence[str] = ()) -> dict[str, Any]:
    """Name the `files` that were written into `folder`; the same for a summary.

    `others` are files that the verb may write: one that is there and not written now is kept, and
    a line says that it is of an earlier run.
    """
    from fembridge.host.terminal import log

    print(f"{', '.join(files)}: {folder}")
    if left := [name for name in others if name not in files and (folder / name).is_file()]:
        log(f"{folder}: of an earlier run: {', '.join(left)}")
    return {"output": folder, "files": files}
