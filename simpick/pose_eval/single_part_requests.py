"""What a detector answers where one part is asked for in a bin of others: one that is there, or one that is not."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from simpick.activity import counted
from simpick.assets.library import get_part
from simpick.estimators.base import Detector
from simpick.estimators.boundary import onboard_parts, validated_detections
from simpick.metrics.intervals import Interval, percentile_interval, resample_bins
from simpick.metrics.masks import match_masks
from simpick.pose_eval.benchmark_bins import MIXED_PARTS, BenchmarkBin, load_view
from simpick.pose_eval.bin_images import BinView
from simpick.pose_eval.detector_benchmark import compare_bin, shown_interval
from simpick.records import Detection
from simpick.terminal import Console, Table, narrow_table, track

LEAST_VISIBLE = 0.5
"""A part is held if an instance of it is visible to this share."""
_ABSENT, _HELD = 3, 2
"""Parts that are asked for in each bin, as far as there are so many."""
_RESAMPLES = 400


@dataclass(frozen=True, eq=False)
class SinglePartAnswer:
    """What was answered to one request."""

    bin: BenchmarkBin
    is_held: bool
    """Whether the bin holds the part, beside others."""
    answers: int
    highest_score: float
    """0 for an empty answer."""
    found: int
    """Instances of the part, visible to `LEAST_VISIBLE` or more, with a mask of an IoU of one half."""
    visible: int
    """Instances of the part that are visible to `LEAST_VISIBLE` or more."""


def ask_for_single_parts(
    make_detector: Callable[[], Detector], bins: Sequence[BenchmarkBin], console: Console | None = None
) -> list[SinglePartAnswer]:
    """Ask in each bin for three parts that it does not hold, and in mixed ones for two that it holds.

    The detector gets neither depth nor instance ids. Which parts are asked for follows from the bin's seed.
    """
    detector = make_detector()
    answers = []
    for bin in track(bins, "asking", console=console):
        view = load_view(bin)
        parts = [get_part(name) for name in _requests(bin, view)]
        onboard_parts([detector], parts)
        for part in counted(parts, "request"):
            detections = validated_detections(detector, view.frame, [part])
            answers.append(judge_answer(bin, view, part.name, detections))
    return answers


def judge_answer(bin: BenchmarkBin, view: BinView, part: str, detections: Sequence[Detection]) -> SinglePartAnswer:
    """Return how an answer to the request for one part compares with what the bin holds."""
    compared = compare_bin(bin, view, detections)
    fractions = compared.overlaps.visible_fractions
    visible = {k for k, name in enumerate(compared.truths) if name == part and fractions[k] >= LEAST_VISIBLE}
    hits = set(match_masks(compared.overlaps, 0.5).tolist())
    highest = max((detection.score for detection in detections), default=0.0)
    return SinglePartAnswer(bin, bool(visible), len(detections), highest, len(visible & hits), len(visible))


def answers_table(answers: Sequence[SinglePartAnswer], seed: int = 0) -> Table:
    """Return figures with 95 % intervals (bootstrap over bins) for absent parts by kind of bin, and for held parts."""
    groups = {
        "absent, mixed": [a for a in answers if not a.is_held and a.bin.kind == "mixed"],
        "absent, homogeneous": [a for a in answers if not a.is_held and a.bin.kind == "homogeneous"],
        "held among others": [a for a in answers if a.is_held],
    }
    columns = {name: answer_intervals(group, seed) for name, group in groups.items() if group}
    rows = [
        [figure, *(shown_interval(intervals[figure]) for intervals in columns.values())]
        for figure in next(iter(columns.values()))
    ]
    headings = [f"{name} ({len(groups[name])} requests)" for name in columns]
    return narrow_table("", *headings, rows=rows, title="one part asked for")


def answer_intervals(answers: Sequence[SinglePartAnswer], seed: int = 0) -> dict[str, Interval]:
    """Return each figure with its interval: shares in percent, NaN where there is nothing to find."""
    seeds = sorted({answer.bin.seed for answer in answers})
    index = np.array([seeds.index(answer.bin.seed) for answer in answers])
    counts = resample_bins(len(seeds), _RESAMPLES, np.random.default_rng(seed))
    one = np.ones(len(answers))

    def ratio(values: Iterable[float], of: np.ndarray) -> Interval:
        sums = np.array([np.bincount(index, x, len(seeds)) for x in (np.array(list(values), float), of)])
        resampled = counts @ sums.T
        total = sums.sum(axis=1)
        value = total[0] / total[1] if total[1] else float("nan")
        return percentile_interval(float(value), resampled[:, 0] / np.maximum(resampled[:, 1], 1))

    visible = np.array([answer.visible for answer in answers], float)
    return {
        "empty answers [%]": ratio((100.0 * (a.answers == 0) for a in answers), one),
        "highest score below 0.5 [%]": ratio((100.0 * (a.highest_score < 0.5) for a in answers), one),
        "detections": ratio((float(a.answers) for a in answers), one),
        "found [%]": ratio((100.0 * a.found for a in answers), visible),
    }


def _requests(bin: BenchmarkBin, view: BinView) -> list[str]:
    rng = np.random.default_rng((bin.seed, 3))
    held = sorted({t.part for t in view.truths if t.visible_fraction >= LEAST_VISIBLE}) if bin.kind == "mixed" else []
    absent = [name for name in MIXED_PARTS if name not in {part.name for part in view.parts}]
    return [str(name) for names, count in ((absent, _ABSENT), (held, _HELD)) for name in rng.permutation(names)[:count]]
