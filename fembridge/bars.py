"""Bars on a terminal, on stderr, that go when they are done; rich when it is due."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import rich.progress


def start_bars() -> "rich.progress.Progress":
    """Show bars with a name, a share and a field ``told``; `stop` takes them away."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

    bars = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        TaskProgressColumn(),
        TextColumn("{task.fields[told]}", markup=False),
        console=Console(stderr=True),
        transient=True,
    )
    bars.start()
    return bars
