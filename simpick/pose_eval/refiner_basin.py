"""The refiner's basin of convergence: final error by initial error and visibility."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from simpick.estimators.refiner import Refiner
from simpick.geometry import so3_exp
from simpick.plotting import new_figure, save_figure
from simpick.pose_eval.bin_images import BinView
from simpick.pose_eval.pose_evaluation import estimate_errors
from simpick.pose_eval.pose_images import PoseImage, library_model
from simpick.pose_eval.pose_sources import PoseSource, answers
from simpick.records import PoseEstimate, PoseHypothesis

BANDS = ((0.1, 0.5), (0.5, 0.9), (0.9, 1.0))
"""Visibility bands, each with its own curve."""


@dataclass(frozen=True, eq=False)
class BasinPoint:
    """One refinement from a perturbed true pose."""

    start_deg: float
    end_deg: float
    visible_fraction: float


def perturbed(
    T_camera_part: Float[np.ndarray, "4 4"], rotation_deg: float, depth_fraction: float, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """Return the pose rotated by this angle about a random axis, and moved in depth by up to this fraction."""
    axis = rng.normal(size=3)
    T = T_camera_part.copy()
    T[:3, :3] = so3_exp(np.radians(rotation_deg) * axis / np.linalg.norm(axis)) @ T[:3, :3]
    T[:3, 3] *= 1 + depth_fraction * rng.uniform(-1, 1)
    return T


class PerturbedTruths(PoseSource):
    """Refines the perturbed true pose of every detected part that is at least a tenth visible."""

    def __init__(self, refiner: Refiner, start_deg: float, depth_fraction: float, rng: np.random.Generator) -> None:
        self._refiner, self._start_deg, self._depth_fraction, self._rng = refiner, start_deg, depth_fraction, rng

    def prepare(self, image: PoseImage) -> None:
        """Onboard the image's parts."""
        for name in sorted({detection.part for detection in image.detections}):
            self._refiner.onboard(library_model(name).rendered)

    def estimate(self, image: PoseImage) -> list[PoseEstimate]:
        """Return the best refined pose of each detection, with one start each."""
        Ts_true = {t.instance: t.T_camera_part for t in image.truths if t.visible_fraction >= BANDS[0][0]}
        detections = [d for d in image.detections if d.instance in Ts_true]
        starts = [
            [PoseHypothesis(perturbed(Ts_true[d.instance], self._start_deg, self._depth_fraction, self._rng), 1.0)]
            for d in detections
            if d.instance is not None
        ]
        refined = self._refiner.refine(image.frame, detections, starts)
        return [
            PoseEstimate(d.part, best_first[0].T_camera_part, best_first[0].score, "refiner", 0.0, best_first, d)
            for d, best_first in zip(detections, refined, strict=True)
        ]


def measure_basin(
    views: Iterable[BinView], refiner: Refiner, starts_deg: Sequence[float], depth_fraction: float, seed: int
) -> list[BasinPoint]:
    """Refine every part that is at least a tenth visible from each of these rotation errors, one start each."""
    rng = np.random.default_rng(seed)
    points = []
    for view in views:
        image = view.image("perfect")
        for start_deg in starts_deg:
            for answer in answers([image], PerturbedTruths(refiner, start_deg, depth_fraction, rng)):
                points += [
                    BasinPoint(start_deg, error.rotation_deg, truth.visible_fraction)
                    for _, truth, error in estimate_errors(answer, library_model)
                ]
    return points


def plot_basin(points: Sequence[BasinPoint], file: Path) -> None:
    """Write a plot of median final rotation error and of the share of results below 5 deg, by initial error."""
    figure = new_figure(9, 4)
    left, right = figure.subplots(1, 2)
    starts = sorted({point.start_deg for point in points})
    for low, high in BANDS:
        own = [p for p in points if low <= p.visible_fraction and (p.visible_fraction < high or high == 1.0)]
        ends = [np.array([p.end_deg for p in own if p.start_deg == start]) for start in starts]
        known = [(start, end) for start, end in zip(starts, ends, strict=True) if len(end)]
        if not known:
            continue
        label = f"{100 * low:.0f}-{100 * high:.0f} % visible (n = {len(known[0][1])})"
        left.plot([s for s, _ in known], [np.median(end) for _, end in known], "o-", label=label)
        right.plot([s for s, _ in known], [100 * np.mean(end < 5) for _, end in known], "o-", label=label)
    left.plot(starts, starts, color="0.7", label="no refinement")
    left.set_ylabel("final rotation error, median deg")
    right.set_ylabel("ends below 5 deg, %")
    right.set_ylim(0, 102)
    for axes in (left, right):
        axes.set_xlabel("initial rotation error, deg")
        axes.grid(color="0.9")
    left.legend(fontsize=8)
    save_figure(figure, file)
