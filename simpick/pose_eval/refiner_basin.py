"""The refiner's basin of convergence: from how far off does it find the true pose, by how much of the part is seen?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from simpick.assets.library import get_part
from simpick.estimators.refiner import Refiner
from simpick.geometry import so3_exp
from simpick.metrics.models import EvaluationModel
from simpick.metrics.pose_errors import batch_pose_errors
from simpick.plotting import new_figure, save_figure
from simpick.pose_eval.bin_images import BinView
from simpick.records import PoseHypothesis

BANDS = ((0.1, 0.5), (0.5, 0.9), (0.9, 1.0))
"""Bounds of the visible share, of which each gets its own curve."""


@dataclass(frozen=True, eq=False)
class BasinPoint:
    """One refinement from a perturbed true pose."""

    start_deg: float
    end_deg: float
    end_mm: float
    visible_fraction: float


def perturbed(
    T_camera_part: Float[np.ndarray, "4 4"], rotation_deg: float, depth_share: float, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    """Return the pose turned by this angle about a random axis, and nearer or farther by up to this share."""
    axis = rng.normal(size=3)
    T = T_camera_part.copy()
    T[:3, :3] = so3_exp(np.radians(rotation_deg) * axis / np.linalg.norm(axis)) @ T[:3, :3]
    T[:3, 3] *= 1 + depth_share * rng.uniform(-1, 1)
    return T


def measure_basin(
    views: Sequence[BinView], refiner: Refiner, starts_deg: Sequence[float], depth_share: float, seed: int
) -> list[BasinPoint]:
    """Refine every part that is a tenth or more visible from each of these rotation errors, one start each."""
    rng = np.random.default_rng(seed)
    points = []
    for view in views:
        image = view.image("perfect")
        truths = {truth.instance: truth for truth in image.truths}
        for part in {part.name: part for part in view.parts}.values():
            refiner.onboard(part)
        detections = [
            d for d in image.detections if d.instance is not None and truths[d.instance].visible_fraction >= BANDS[0][0]
        ]
        true = [truths[d.instance] for d in detections if d.instance is not None]
        for start_deg in starts_deg:
            starts = [perturbed(t.T_camera_part, start_deg, depth_share, rng) for t in true]
            refined = refiner.refine(image.frame, detections, [[PoseHypothesis(T, 1.0)] for T in starts])
            for truth, best_first in zip(true, refined, strict=True):
                model = EvaluationModel.of(get_part(truth.part))
                T = best_first[0].T_camera_part
                error = batch_pose_errors(T[None], truth.T_camera_part[None], model)[0]
                points.append(BasinPoint(start_deg, error.rotation_deg, error.translation_mm, truth.visible_fraction))
    return points


def plot_basin(points: Sequence[BasinPoint], file: Path) -> None:
    """Write a plot: median final rotation error, and share of starts that end below 5 deg, by initial error."""
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
