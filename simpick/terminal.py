"""What simpick shows on the terminal: progress bars, and tables that fit into 80 columns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, TypeVar

from rich import console as rich_console
from rich.box import SIMPLE
from rich.markdown import Markdown as Markdown
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table as Table
from rich.text import Text as Text

_Item = TypeVar("_Item")


class Console(rich_console.Console):
    """The terminal, or a file in its place; texts are shown as they are, because paths may hold brackets."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"markup": False, **options})

    def print_line(self, text: str) -> None:
        """Print text as it is; only the terminal wraps it, so that a path can be copied."""
        self.print(text, soft_wrap=True)


def narrow_table(
    *columns: str, title: str | None = None, rows: Iterable[Sequence[str]] = (), labels: int = 1, padding: int = 1
) -> Table:
    """Return a table of labels, aligned to the left, and figures, aligned to the right.

    The first `labels` columns hold labels. `padding` is the space after each column, in characters.
    """
    table = Table(box=SIMPLE, pad_edge=False, padding=(0, padding, 0, 0), title=title)
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k < labels else "right", overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def progress_bar(console: Console | None = None, *, keep: bool = False) -> Progress:
    """Return a progress display: description, bar, count, elapsed and remaining time; it disappears unless kept."""
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=not keep,
    )


def share_bar(before: str, after: str, end: str, *, console: Console) -> Progress:
    """Return a progress display of a share of work, with texts of its tasks before the bar, after it and at the end."""
    return Progress(
        TextColumn(before, markup=False),
        BarColumn(bar_width=24),
        TaskProgressColumn(),
        TextColumn(after, markup=False),
        TimeElapsedColumn(),
        TextColumn(end, markup=False),
        console=console,
    )


def track(
    items: Iterable[_Item], description: str, *, total: int | None = None, console: Console | None = None
) -> Iterator[_Item]:
    """Yield the items while a progress bar counts those that were consumed."""
    with progress_bar(console) as bar:
        task = bar.add_task(description, total=total)
        for item in items:
            yield item
            bar.advance(task)
