"""A detector training run's progress on the terminal: one line that is redrawn, and one line per validation."""

from __future__ import annotations

from typing import Any

from simpick.terminal import Console, share_bar
from simpick.training.progress import time_left


class DetectorProgress:
    """Shows the rows of the log as they are written. A context manager."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bar = share_bar(
            "step {task.fields[step]}", "{task.fields[figures]}", "{task.fields[left]}", console=console
        )
        self._task = self._bar.add_task("train", total=1.0, step=0, figures="making bins", left="")

    def show(self, row: dict[str, Any], progress: float) -> None:
        """Take one row of the log and the share of the run that is done."""
        if row["split"] == "validation":
            self._console.print(validation_line(row))
            self._bar.update(self._task, completed=progress, step=row["step"])
            return
        figures = f"loss {row['loss']:.3f} · {row['crops_per_s']:.1f} crops/s"
        left = time_left(row["seconds"], progress)
        self._bar.update(self._task, completed=progress, step=row["step"], figures=figures, left=left)

    def __enter__(self) -> DetectorProgress:
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.stop()


def validation_line(row: dict[str, Any]) -> str:
    """Return one validation's figures as a line."""
    return (
        f"{row['step']:>7} steps: AP50 {row['ap50']:.2f}, AP {row['ap']:.2f}, PQ {row['pq']:.2f}; "
        f"found {row['recall']:.0%}, merged {row['merges']:.0%}, split {row['splits']:.0%}"
    )
