"""Tolerance of grasping to pose error: the share of grasps that delivered a part, by the error of their pose.

A mode whose grasps fail with good poses is limited by something other than its poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from simpick.experiments.analysis.failure_causes import TOLERATED_DEG, TOLERATED_MM
from simpick.metrics.intervals import wilson_interval
from simpick.records import PickOutcome, PickRecord

ErrorKey = Literal["rotation_deg", "translation_mm"]
ERROR_EDGES: dict[ErrorKey, tuple[float, ...]] = {
    "rotation_deg": (0.0, 1, 2, 5, 10, 20, 45, 180.1),
    "translation_mm": (0.0, 1, 2, 5, 10, 20, 40, np.inf),
}


@dataclass(frozen=True)
class SuccessShare:
    """Grasps whose pose errors lie in one range."""

    label: str
    """The range, in the error's unit."""
    successes: int
    attempts: int

    @property
    def share(self) -> float:
        """Return the share that delivered a part; NaN without attempts."""
        return self.successes / self.attempts if self.attempts else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """Return Wilson's 95 % interval of the share."""
        return wilson_interval(self.share, self.attempts)


def success_by_error(picks: Sequence[PickRecord], key: ErrorKey) -> list[SuccessShare]:
    """Return the share for each range of `ERROR_EDGES`, lower edge included, of picks whose error is known."""
    shares = []
    for low, high in pairwise(ERROR_EDGES[key]):
        inside = [p for p in picks if p.pose_error is not None and low <= getattr(p.pose_error, key) < high]
        shares.append(_share(f"over {low:g}" if high > 180 else f"{low:g}-{high:g}", inside))
    return shares


def success_by_pose(picks: Sequence[PickRecord]) -> tuple[SuccessShare, SuccessShare]:
    """Return the shares with good poses, within `TOLERATED_DEG` and `TOLERATED_MM`, and with all others."""
    good, off = [], []
    for pick in picks:
        error = pick.pose_error
        if error is not None:
            is_good = error.rotation_deg <= TOLERATED_DEG and error.translation_mm <= TOLERATED_MM
            (good if is_good else off).append(pick)
    limits = f"{TOLERATED_DEG:g} deg and {TOLERATED_MM:g} mm"
    return _share(f"pose within {limits}", good), _share("larger pose error", off)


def _share(label: str, picks: Sequence[PickRecord]) -> SuccessShare:
    return SuccessShare(label, sum(p.outcome is PickOutcome.SUCCESS for p in picks), len(picks))
