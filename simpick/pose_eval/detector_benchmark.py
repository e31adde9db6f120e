"""How well a detector finds and names library parts in the pose benchmark's fixed bins."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from simpick.assets.library import get_part
from simpick.estimators.base import Detector
from simpick.estimators.boundary import onboard_parts, validated_detections
from simpick.metrics.intervals import Interval, percentile_interval, resample_bins
from simpick.metrics.mask_scores import CONFIDENT, MaskScores
from simpick.metrics.masks import MaskOverlaps, mask_overlaps, match_masks
from simpick.pose_eval.benchmark_bins import BenchmarkBin, load_view
from simpick.pose_eval.bin_images import BinView
from simpick.records import Detection
from simpick.terminal import Console, Table, narrow_table, track

VISIBILITY = ((0.3, 0.5), (0.5, 0.7), (0.7, 0.9), (0.9, 1.01))
"""Ranges of the visible share by which recall is reported."""
_RESAMPLES = 400


@dataclass(frozen=True, eq=False)
class BinDetections:
    """What a detector found in one bin."""

    bin: BenchmarkBin
    overlaps: MaskOverlaps
    names: tuple[str, ...]
    """The part of each detection."""
    truths: tuple[str, ...]
    """The part of each instance."""
    elapsed_s: float


def detect_bins(
    make_detector: Callable[[], Detector], bins: Sequence[BenchmarkBin], console: Console | None = None
) -> list[BinDetections]:
    """Return what a detector finds in each bin, of the parts that the bin is filled from.

    The detector gets neither depth nor instance ids.
    """
    detector = make_detector()
    found = []
    for bin in track(bins, "detecting", console=console):
        view = load_view(bin)
        parts = [get_part(name) for name in bin.config.parts]
        onboard_parts([detector], parts)
        # A detector that has no `onboard` may prepare for parts when it first sees them.
        if not found or any(part.name not in found[-1].bin.config.parts for part in parts):
            validated_detections(detector, view.frame, parts)
        start = time.perf_counter()
        detections = validated_detections(detector, view.frame, parts)
        found.append(compare_bin(bin, view, detections, time.perf_counter() - start))
    return found


def compare_bin(
    bin: BenchmarkBin, view: BinView, detections: Sequence[Detection], elapsed_s: float = 0.0
) -> BinDetections:
    """Return how detections overlap a bin's instances; a detection without mask covers its box."""
    ids = view.frame.instances
    assert ids is not None
    seen = [truth for truth in view.truths if (ids == truth.instance).any()]
    masks = [detection.mask if detection.mask is not None else _box(detection, ids.shape) for detection in detections]
    overlaps = mask_overlaps(
        np.array(masks, bool).reshape(-1, *ids.shape),
        np.array([detection.score for detection in detections], float),
        np.array([ids == truth.instance for truth in seen], bool).reshape(-1, *ids.shape),
        np.array([truth.visible_fraction for truth in seen], float),
    )
    names, truths = tuple(d.part for d in detections), tuple(truth.part for truth in seen)
    return BinDetections(bin, overlaps, names, truths, elapsed_s)


def figures_table(found: Sequence[BinDetections], seed: int = 0) -> Table:
    """Return figures with 95 % intervals (bootstrap over bins): of all bins, the mixed and the homogeneous ones."""
    kinds = {"all": found, **{k: [f for f in found if f.bin.kind == k] for k in ("mixed", "homogeneous")}}
    columns = {kind: detection_intervals(group, seed) for kind, group in kinds.items() if group}
    rows = [
        [name, *(shown_interval(intervals[name]) for intervals in columns.values())]
        for name in next(iter(columns.values()))
    ]
    headings = [f"{kind} ({len(kinds[kind])} bins)" for kind in columns]
    return narrow_table("", *headings, rows=rows, title="detections of parts visible to 30 % or more")


def detection_intervals(found: Sequence[BinDetections], seed: int = 0) -> dict[str, Interval]:
    """Return each figure with its interval, in percent but for the time in milliseconds."""
    scores = MaskScores([f.overlaps for f in found])
    values = {name: 100 * value for name, value in asdict(scores.figures()).items()}
    counts = resample_bins(len(found), _RESAMPLES, np.random.default_rng(seed))
    resampled = [asdict(scores.figures(row.astype(float))) for row in counts]
    intervals = {
        name: percentile_interval(value, np.array([100 * r[name] for r in resampled], float))
        for name, value in values.items()
    }
    tallies = [_tally(f) for f in found]
    for name in tallies[0]:
        parts = np.array([tally[name] for tally in tallies], float)
        ratios = counts @ parts
        total = parts.sum(axis=0)
        intervals[name] = percentile_interval(
            float(100 * total[0] / max(total[1], 1)), 100 * ratios[:, 0] / np.maximum(ratios[:, 1], 1)
        )
    times = 1000 * np.array([f.elapsed_s for f in found])
    intervals["ms per frame"] = percentile_interval(float(times.mean()), (counts @ times) / len(found))
    return intervals


def _tally(found: BinDetections) -> dict[str, tuple[float, float]]:
    """Return numerator and denominator of naming accuracy, and of recall by visibility."""
    matches = match_masks(found.overlaps, 0.5)
    hits = [(k, int(m)) for k, m in enumerate(matches) if m >= 0]
    recalled = {m for _, m in hits}
    is_right = {k: found.names[k] == found.truths[m] for k, m in hits}
    sure = [right for k, right in is_right.items() if found.overlaps.scores[k] >= CONFIDENT]
    rows: dict[str, tuple[float, float]] = {
        "named right": (sum(is_right.values()), len(hits)),
        "named right, score 0.5 or more": (sum(sure), len(sure)),
    }
    for low, high in VISIBILITY:
        inside = [m for m, fraction in enumerate(found.overlaps.visible_fractions) if low <= fraction < high]
        name = f"found, {low:.0%} to {min(high, 1):.0%} visible"
        rows[name] = (sum(m in recalled for m in inside), len(inside))
    return rows


def shown_interval(interval: Interval) -> str:
    """Return a figure and its interval as one cell of a table."""
    if not interval.is_known:
        return "-" if np.isnan(interval.value) else f"{interval.value:.1f}"
    return f"{interval.value:.1f} ({interval.low:.1f} to {interval.high:.1f})"


def _box(detection: Detection, shape: tuple[int, ...]) -> np.ndarray:
    mask = np.zeros(shape, bool)
    x1, y1, x2, y2 = np.rint(np.clip(detection.box_xyxy_px, 0, None)).astype(int)
    mask[y1:y2, x1:x2] = True
    return mask
