"""What each estimator gains over the one before, on the same bins, with paired bootstrap intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from simpick.metrics.intervals import Interval, percentile_interval, resample_bins, resampled_ratio
from simpick.pose_eval.benchmark_runs import BinFigures, PoseBenchmarkResult
from simpick.terminal import Table, narrow_table

FIGURES = ("ar", "below_5_deg")
"""Of `BinFigures`: what is compared."""
_RESAMPLES = 10_000


@dataclass(frozen=True)
class Gain:
    """How much better one estimator is than another on the same bins."""

    estimator: str
    before: str
    """Who it is compared with."""
    noise: str
    """Preset of the detections."""
    differences: dict[str, Interval]
    """By figure, as shares: this estimator's less the other's, with 95 % intervals over bins."""


def gains(results: Sequence[PoseBenchmarkResult]) -> list[Gain]:
    """Return each estimator's gain over the one before it, for every preset of detections that both have."""
    return [
        Gain(after.estimator, before.estimator, noise, _differences(before.by_bin[noise], after.by_bin[noise]))
        for before, after in pairwise(results)
        for noise in after.by_bin
        if noise in before.by_bin
    ]


def gains_table(gains: Sequence[Gain]) -> Table | None:
    """Return the gains in points; None if there are none."""
    if not gains:
        return None
    title = "Gain over the one before, points, 95 % intervals over bins"
    table = narrow_table("estimator", "over", "detections", "AR", "rotation < 5 deg", title=title, labels=3)
    for gain in gains:
        table.add_row(gain.estimator, gain.before, gain.noise, *(_cell(gain.differences[name]) for name in FIGURES))
    return table


def _differences(before: Sequence[BinFigures], after: Sequence[BinFigures]) -> dict[str, Interval]:
    # Targets are the same for both: they are the bins', whoever answers.
    targets = np.array([figures.targets for figures in after], float)
    counts = resample_bins(len(targets), _RESAMPLES, np.random.default_rng(0))
    differences = {}
    for name in FIGURES:
        change = np.array([getattr(b, name) - getattr(a, name) for a, b in zip(before, after, strict=True)])
        # A bin without targets has no share.
        found = np.where(targets > 0, change, 0.0) * targets
        value = found.sum() / max(targets.sum(), 1.0)
        differences[name] = percentile_interval(value, resampled_ratio(counts, found, targets))
    return differences


def _cell(interval: Interval) -> str:
    return f"{100 * interval.value:+.1f} ({100 * interval.low:+.1f} to {100 * interval.high:+.1f})"
