"""Outcomes to fit the refiner's confidence on random training parts and to check it on library parts."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from simpick.assets.library import get_part
from simpick.caching import atomic_write_text
from simpick.estimators.boundary import onboard_parts, without_truth
from simpick.estimators.pose_selection import best_per_group
from simpick.estimators.refiner.confidence import FEATURES, GOOD_DEG, GOOD_MM, Confidence
from simpick.estimators.refiner.refined_estimator import RefinedEstimator
from simpick.metrics import pose_error
from simpick.plotting import new_figure, save_figure
from simpick.pose_eval.bin_images import BinView, view_bin
from simpick.pose_eval.pose_images import PoseImage, PoseTruth, library_model
from simpick.records import Detection
from simpick.scene import SceneConfig

_FIRST_BIN_SEED, _FIRST_PART_SEED = 61_000, 700_000


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Poses with the evidence for them, and whether they were good."""

    detection: Int[np.ndarray, "n"]
    """Number of the detection that each pose answers."""
    features: Float[np.ndarray, "n cues"]
    good: Float[np.ndarray, "n"]
    """1 where rotation and translation error are below `GOOD_DEG` and `GOOD_MM`, else 0."""

    def best(self, confidence: Confidence) -> Outcomes:
        """Return the most probable pose of each detection."""
        rows = best_per_group(self.detection, -confidence.probability(self.features), 1)
        return Outcomes(self.detection[rows], self.features[rows], self.good[rows])


def random_bin(number: int, parts: int, count: int) -> BinView:
    """Return the view of calibration bin `number`: `count` instances of `parts` random parts of its own."""
    first = _FIRST_PART_SEED + number * parts
    names = tuple(f"random_{seed}" for seed in range(first, first + parts))
    config = SceneConfig(parts=names, count=count, robot=None, randomization="default")
    return view_bin(config, _FIRST_BIN_SEED + number)[0]


def pooled(parts: Iterable[Outcomes]) -> Outcomes:
    """Return all outcomes as one set."""
    parts = list(parts)
    firsts = np.cumsum([0, *(int(o.detection.max(initial=-1)) + 1 for o in parts)])
    return Outcomes(
        np.concatenate([o.detection + first for o, first in zip(parts, firsts[:-1], strict=True)]),
        np.concatenate([o.features for o in parts]),
        np.concatenate([o.good for o in parts]),
    )


def outcomes(views: Iterable[BinView], estimator: RefinedEstimator, detections: Sequence[str]) -> Outcomes:
    """Refine the poses of all parts in these bins, with each of these detections by name."""
    detection, features, good = [], [], []
    for image in (view.image(name) for view in views for name in detections):
        onboard_parts([estimator], [get_part(name) for name in sorted({found.part for found in image.detections})])
        for found, finalists in estimator.finalists(without_truth(image.frame), image.detections):
            truth = _truth_of(image, found)
            number = detection[-1] + 1 if detection else 0
            for finalist in finalists:
                detection.append(number)
                features.append(finalist.cues)
                good.append(truth is not None and _is_good(finalist.T_camera_part, truth))
    return Outcomes(np.array(detection, int), np.array(features).reshape(-1, len(FEATURES)), np.array(good, float))


def _truth_of(image: PoseImage, detection: Detection) -> PoseTruth | None:
    """Return the truth that a detection shows: the instance with most of its pixels, if it is of the same part."""
    assert image.frame.instances is not None and detection.mask is not None
    seen = image.frame.instances[detection.mask]
    counts = np.bincount(seen[seen >= 0], minlength=1)
    shown = int(counts.argmax())
    truths = [t for t in image.truths if t.instance == shown and t.part == detection.part and counts[shown]]
    return truths[0] if truths else None


def _is_good(T_camera_part: Float[np.ndarray, "4 4"], truth: PoseTruth) -> bool:
    error = pose_error(T_camera_part, truth.T_camera_part, library_model(truth.part).evaluation)
    return error.rotation_deg < GOOD_DEG and error.translation_mm < GOOD_MM


def brier_score(probability: Float[np.ndarray, "n"], good: Float[np.ndarray, "n"]) -> float:
    """Return the mean squared difference of probability and outcome: 0 is perfect, 0.25 for a coin flip."""
    return float(np.mean((probability - good) ** 2))


def write_confidence(confidence: Confidence, provenance: dict[str, Any], file: Path) -> None:
    """Write the model with its provenance."""
    weights = dict(zip(FEATURES, confidence.weights, strict=True))
    content = {"bias": confidence.bias, "weights": weights, "good": {"mm": GOOD_MM, "deg": GOOD_DEG}, **provenance}
    atomic_write_text(file, json.dumps(content, indent=2) + "\n")


def plot_reliability(checked: Mapping[str, Outcomes], confidence: Confidence, file: Path) -> None:
    """Write reliability plots: observed against predicted share of good poses, in ten groups of equal size.

    There is one plot per named set of outcomes.
    """
    figure = new_figure(4.6 * len(checked), 4.4)
    for axes, (name, own) in zip(
        np.atleast_1d(figure.subplots(1, len(checked), sharey=True)), checked.items(), strict=True
    ):
        axes.plot([0, 1], [0, 1], color="0.7", label="perfectly calibrated")
        predicted = confidence.probability(own.features)
        order = np.argsort(predicted, kind="stable")
        groups = [group for group in np.array_split(order, 10) if len(group)]
        x, y = [predicted[g].mean() for g in groups], [own.good[g].mean() for g in groups]
        axes.plot(x, y, "o-", label=f"Brier {brier_score(predicted, own.good):.3f}")
        axes.set_xlabel("predicted")
        axes.set_title(f"{name}: {len(own.good)} poses, {100 * own.good.mean():.0f} % good")
        axes.legend(fontsize=8)
        axes.grid(color="0.9")
    figure.axes[0].set_ylabel(f"share of poses < {GOOD_MM:g} mm and < {GOOD_DEG:g} deg")
    save_figure(figure, file)
