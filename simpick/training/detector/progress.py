"""A detector training run's progress on the terminal."""

from __future__ import annotations

from typing import Any

from simpick.training.progress import TrainProgress


class DetectorProgress(TrainProgress):
    """Shows the rows of a detector's log."""

    waiting = "making bins"

    def figures(self, row: dict[str, Any]) -> str:
        """Return the figures of one row of training."""
        return f"loss {row['loss']:.3f} · {row['crops_per_s']:.1f} crops/s · {row['bins']} bins"

    def validation_line(self, row: dict[str, Any]) -> str:
        """Return one validation's figures as a line."""
        return (
            f"{row['step']:>7} steps: AP50 {row['ap50']:.2f}, AP {row['ap']:.2f}, PQ {row['pq']:.2f}; "
            f"found {row['recall']:.0%}, merged {row['merges']:.0%}, split {row['splits']:.0%}"
        )

    def validation_summary(self, row: dict[str, Any]) -> str:
        """Return the figure that stays beside the loss."""
        return f"held out AP50 {row['ap50']:.2f}"
