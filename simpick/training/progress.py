"""A training run's progress on the terminal: one line that is redrawn, and one line per validation."""

from __future__ import annotations

from typing import Any

from simpick.terminal import Console, share_bar


class TrainProgress:
    """Shows the rows of the log as they are written. A context manager; other networks override what rows say."""

    waiting = "waiting for data"
    """Shown before the first row."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bar = share_bar(
            "step {task.fields[step]}", "{task.fields[figures]}", "{task.fields[left]}", console=console
        )
        self._task = self._bar.add_task("train", total=1.0, step=0, figures=self.waiting, left="")
        self._validation = ""

    def show(self, row: dict[str, Any], progress: float) -> None:
        """Take one row of the log and the share of the run that is done."""
        if row["split"] == "validation":
            self._validation = f" · {self.validation_summary(row)}"
            self._console.print(self.validation_line(row))
            self._bar.update(self._task, completed=progress, step=row["step"])
            return
        figures, left = self.figures(row) + self._validation, time_left(row["seconds"], progress)
        self._bar.update(self._task, completed=progress, step=row["step"], figures=figures, left=left)

    def figures(self, row: dict[str, Any]) -> str:
        """Return the figures of one row of training."""
        return f"loss {row['loss']:.3f} · {row['queries_per_s']:.0f} queries/s · {row['waiting_share']:.0%} waiting"

    def validation_line(self, row: dict[str, Any]) -> str:
        """Return one validation's figures as a line."""
        return (
            f"{row['queries']:>9} queries, held out: median {row['rotation_deg']:.1f} deg, depth "
            f"{row['depth_percent']:.1f} %; {row['below_5_deg']:.0%} below 5 deg, {row['below_15_deg']:.0%} below 15, "
            f"{row['below_30_deg']:.0%} below 30"
        )

    def validation_summary(self, row: dict[str, Any]) -> str:
        """Return the figures of the last validation that stay beside the loss."""
        return f"held out {row['rotation_deg']:.1f} deg, {row['below_15_deg']:.0%} < 15 deg"

    def __enter__(self) -> TrainProgress:
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.stop()


def time_left(seconds: float, progress: float) -> str:
    """Return the time that is left of a run, at its speed so far."""
    if not 0 < progress < 1:
        return ""
    minutes = seconds * (1 - progress) / progress / 60
    return f"{minutes / 60:.1f} h left" if minutes >= 90 else f"{minutes:.0f} min left"
