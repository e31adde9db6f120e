"""What simpick shows on the terminal: progress bars, and tables that fit into 80 columns.

In a file or a pipe, where a bar cannot be redrawn, progress is plain lines: the first after a second, then one every
few seconds, so that no command is silent.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence, Sized
from contextlib import contextmanager, suppress
from datetime import timedelta
from threading import Event, Thread
from typing import Any, TypeVar
from weakref import WeakSet

from rich import console as rich_console
from rich.box import SIMPLE
from rich.markdown import Markdown as Markdown
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as RichProgress
from rich.table import Table as Table
from rich.text import Text as Text

from simpick.activity import current_activity

_Item = TypeVar("_Item")

FIRST_LINE_S = 1.0
"""Where lines stand for a bar, the first is written after this time; what is over by then needs none."""
LINE_EVERY_S = 4.0
"""Time between two lines, also where nothing has advanced: the elapsed time has."""


_displays: WeakSet[RichProgress] = WeakSet()
"""Progress displays that are shown now."""
_last_text_s = 0.0
"""When text was last printed, by the monotonic clock."""


class Console(rich_console.Console):
    """The terminal, or a file in its place; texts are shown as they are, because paths may hold brackets."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"markup": False, **options})

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as rich does."""
        global _last_text_s
        super().print(*objects, **options)
        _last_text_s = time.monotonic()

    def print_line(self, text: str) -> None:
        """Print text as it is; only the terminal wraps it, so that a path can be copied."""
        self.print(text, soft_wrap=True)


class _ActivityColumn(TextColumn):
    """What is being done at this moment; lines say it themselves, at their end."""

    def __init__(self) -> None:
        super().__init__("", markup=False)

    def render(self, task: Task) -> Text:
        return Text(current_activity() if not task.finished else "", style="dim")


class Progress(RichProgress):
    """A progress display: bars on a terminal, plain lines elsewhere."""

    _lines: Thread | None = None

    def start(self) -> None:
        """Show the bars, or begin to write lines."""
        _displays.add(self)
        if self.console.is_interactive or self.console.is_jupyter:
            super().start()
        elif self._lines is None:
            self._stopped = Event()
            # A thread, because the work in between may take minutes without a word.
            self._lines = Thread(target=self._write_until_stopped, name="progress lines", daemon=True)
            self._lines.start()

    def stop(self) -> None:
        """Remove the bars, unless they are kept, or end the lines with a last one."""
        _displays.discard(self)
        if self._lines is None:
            super().stop()
            return
        self._stopped.set()
        self._lines.join()
        self._lines = None
        if not self.live.transient:
            self._write_lines(self.tasks)

    def _write_until_stopped(self) -> None:
        wait_s = FIRST_LINE_S
        while not self._stopped.wait(wait_s):
            # A full disk stops the lines; the command meets it itself, with what it writes next.
            with suppress(OSError):
                self._write_lines([task for task in self.tasks if not task.finished])
            wait_s = LINE_EVERY_S

    def _write_lines(self, tasks: Iterable[Task]) -> None:
        for task in tasks:
            columns = [column for column in self.columns if isinstance(column, ProgressColumn)]
            apart = (TimeRemainingColumn, _ActivityColumn)
            shown = [column.render(task) for column in columns if not isinstance(column, apart)]
            words = [text.plain for text in shown if isinstance(text, Text) and text.plain]
            if task.time_remaining:
                words.append(f"{task.time_remaining:.0f} s left")
            if activity := current_activity():
                words.append(f"({activity})")
            self.console.print(" ".join(words), soft_wrap=True, markup=False, highlight=False)


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
        _ActivityColumn(),
        console=console,
        transient=not keep,
    )


@contextmanager
def working(description: str, console: Console | None = None) -> Iterator[None]:
    """Show what is being done, and for how long already, while the block runs: work that has no count."""
    with Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
        _ActivityColumn(),
        console=console,
        transient=True,
    ) as display:
        display.add_task(description, total=None)
        yield


@contextmanager
def breaking_silence(command: str) -> Iterator[None]:
    """While the block runs, write a line where nothing has been shown for a second, and then every few seconds.

    For whole commands: libraries load and files are read before there is progress to show.
    """
    stopped, begun_s = Event(), time.monotonic()

    def watch() -> None:
        patience_s = FIRST_LINE_S
        while not stopped.wait(FIRST_LINE_S / 4):
            now_s = time.monotonic()
            if not _displays and now_s - max(begun_s, _last_text_s) >= patience_s:
                patience_s = LINE_EVERY_S
                with suppress(OSError):
                    work = current_activity() or "at work"
                    Console().print_line(f"simpick {command}: {work}, {timedelta(seconds=int(now_s - begun_s))}")

    watcher = Thread(target=watch, name="silence", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        stopped.set()
        watcher.join()


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
    """Yield the items while a progress bar counts those that were consumed; `total` is for those without a length."""
    if total is None and isinstance(items, Sized):
        total = len(items)
    with progress_bar(console) as bar:
        task = bar.add_task(description, total=total)
        for item in items:
            yield item
            bar.advance(task)
