"""Paired differences between successive estimators on the same bins, with bootstrap intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from simpick.metrics.intervals import Interval, percentile_interval, resample_bins, resampled_ratio
from simpick.pose_eval.benchmark_runs import BinFigures, PoseBenchmarkResult
from simpick.terminal import Table, narrow_table

FIGURES = {"ar": "AR", "below_5_deg": "rotation error < 5 deg"}
"""Compared fields of `BinFigures`, with their table headings."""
_RESAMPLES = 10_000


@dataclass(frozen=True)
class Gain:
    """The difference between two estimators on the same bins."""

    estimator: str
    baseline: str
    """The estimator that it is compared with."""
    detections: str
    """Detection preset."""
    differences: dict[str, Interval]
    """By figure, as fractions: this estimator's less the baseline's, with 95 % intervals over bins."""


def gains(results: Sequence[PoseBenchmarkResult]) -> list[Gain]:
    """Return each estimator's gain over its predecessor, for every detection preset that both have."""
    return [
        Gain(after.estimator, before.estimator, preset, _differences(before.by_bin[preset], after.by_bin[preset]))
        for before, after in pairwise(results)
        for preset in after.by_bin
        if preset in before.by_bin
    ]


def gains_table(gains: Sequence[Gain]) -> Table | None:
    """Return the gains in percentage points; None if there are none."""
    if not gains:
        return None
    rows = [(g.estimator, g.baseline, g.detections, *(_cell(g.differences[name]) for name in FIGURES)) for g in gains]
    known = any(interval.is_known for gain in gains for interval in gain.differences.values())
    over = "95 % intervals over bins" if known else "one bin: no intervals"
    title = f"Gain over the predecessor, percentage points, {over}"
    return narrow_table("estimator", "over", "detections", *FIGURES.values(), title=title, labels=3, rows=rows)


def _differences(before: Sequence[BinFigures], after: Sequence[BinFigures]) -> dict[str, Interval]:
    # Targets are those of the bins, the same for both.
    targets = np.array([figures.targets for figures in after], float)
    counts = resample_bins(len(targets), _RESAMPLES, np.random.default_rng(0))
    differences = {}
    for name in FIGURES:
        change = np.array([getattr(b, name) - getattr(a, name) for a, b in zip(before, after, strict=True)])
        # A bin without targets has no figure.
        found = np.where(targets > 0, change, 0.0) * targets
        value = found.sum() / max(targets.sum(), 1.0)
        differences[name] = percentile_interval(value, resampled_ratio(counts, found, targets))
    return differences


def _cell(interval: Interval) -> str:
    if not interval.is_known:
        return f"{100 * interval.value:+.1f}"
    return f"{100 * interval.value:+.1f} ({100 * interval.low:+.1f} to {100 * interval.high:+.1f})"
