"""A training run's progress on the terminal: one line that is redrawn, and one line per validation."""

from __future__ import annotations

from typing import Any

from simpick.terminal import Console, share_bar


class TrainProgress:
    """Shows the rows of the log as they are written. A context manager."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bar = share_bar(
            "step {task.fields[step]}", "{task.fields[figures]}", "{task.fields[left]}", console=console
        )
        self._task = self._bar.add_task("train", total=1.0, step=0, figures="waiting for data", left="")
        self._validation = ""

    def show(self, row: dict[str, Any], progress: float) -> None:
        """Take one row of the log and the share of the run that is done."""
        if row["split"] == "validation":
            self._validation = f" · held out {row['rotation_deg']:.1f} deg, {row['below_15_deg']:.0%} < 15 deg"
            self._console.print(validation_line(row))
            self._bar.update(self._task, completed=progress, step=row["step"])
            return
        figures = f"loss {row['loss']:.3f} · {row['queries_per_s']:.0f} queries/s · {row['waiting_share']:.0%} waiting"
        left = time_left(row["seconds"], progress)
        self._bar.update(
            self._task, completed=progress, step=row["step"], figures=figures + self._validation, left=left
        )

    def __enter__(self) -> TrainProgress:
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.stop()


def validation_line(row: dict[str, Any]) -> str:
    """Return one validation's figures as a line."""
    return (
        f"{row['queries']:>9} queries: median {row['rotation_deg']:.1f} deg, depth {row['depth_percent']:.1f} %; "
        f"{row['below_5_deg']:.0%} below 5 deg, {row['below_15_deg']:.0%} below 15, {row['below_30_deg']:.0%} below 30"
    )


def time_left(seconds: float, progress: float) -> str:
    """Return the time that is left of a run, at its speed so far."""
    if not 0 < progress < 1:
        return ""
    minutes = seconds * (1 - progress) / progress / 60
    return f"{minutes / 60:.1f} h left" if minutes >= 90 else f"{minutes:.0f} min left"
