"""Outcomes to fit the refiner's confidence on random training parts and to check it on library parts."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from simpick.assets.library import get_part
from simpick.caching import atomic_write_text
from simpick.estimators.refiner.confidence import FEATURES, GOOD_DEG, GOOD_MM, Confidence, confidence_features
from simpick.estimators.refiner.refined_estimator import RefinedEstimator, visible_px
from simpick.plotting import new_figure, save_figure
from simpick.pose_eval.bin_images import BinView, view_bin
from simpick.pose_eval.pose_evaluation import estimate_errors
from simpick.pose_eval.pose_images import library_model
from simpick.pose_eval.pose_sources import EstimatorSource, answers
from simpick.scene import SceneConfig

DETECTIONS = ("perfect", "realistic")
"""Detection presets of calibration; each bin is used with both."""
_FIRST_BIN_SEED, _FIRST_PART_SEED = 61_000, 700_000


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Features of refined poses, and whether the poses were good."""

    features: Float[np.ndarray, "n 3"]
    good: Float[np.ndarray, "n"]
    """1 where rotation and translation error are below `GOOD_DEG` and `GOOD_MM`, else 0."""

    @property
    def plain_scores(self) -> Float[np.ndarray, "n"]:
        """Return the refiner's own scores, which are not probabilities."""
        return np.exp(self.features[:, FEATURES.index("log_score")])


def random_bin(number: int, parts: int, count: int) -> BinView:
    """Return the view of calibration bin `number`: `count` instances of `parts` random parts of its own."""
    first = _FIRST_PART_SEED + number * parts
    names = tuple(f"random_{seed}" for seed in range(first, first + parts))
    config = SceneConfig(parts=names, count=count, robot=None, randomization="default")
    return view_bin(config, _FIRST_BIN_SEED + number)[0]


def pooled(parts: Iterable[Outcomes]) -> Outcomes:
    """Return all outcomes as one set."""
    parts = list(parts)
    return Outcomes(np.concatenate([o.features for o in parts]), np.concatenate([o.good for o in parts]))


def outcomes(views: Iterable[BinView], estimator: RefinedEstimator) -> Outcomes:
    """Estimate the poses of all parts in these bins, with each of the presets `DETECTIONS`."""
    images = (view.image(preset) for view in views for preset in DETECTIONS)
    features, good = [], []
    for answer in answers(images, EstimatorSource(estimator, get_part)):
        for estimate, _, error in estimate_errors(answer, library_model):
            assert estimate.detection is not None and estimate.detection.mask is not None
            features.append(confidence_features(estimate.hypotheses, visible_px(estimate.detection)))
            good.append(error.rotation_deg < GOOD_DEG and error.translation_mm < GOOD_MM)
    return Outcomes(np.array(features).reshape(-1, len(FEATURES)), np.array(good, float))


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

    There is one plot per named set of outcomes, with the confidence's probabilities and the refiner's own scores.
    """
    figure = new_figure(4.6 * len(checked), 4.4)
    for axes, (name, own) in zip(
        np.atleast_1d(figure.subplots(1, len(checked), sharey=True)), checked.items(), strict=True
    ):
        axes.plot([0, 1], [0, 1], color="0.7", label="perfectly calibrated")
        for label, predicted in (
            ("probability", confidence.probability(own.features)),
            ("refiner's own score", own.plain_scores),
        ):
            order = np.argsort(predicted, kind="stable")
            groups = [group for group in np.array_split(order, 10) if len(group)]
            x, y = [predicted[g].mean() for g in groups], [own.good[g].mean() for g in groups]
            axes.plot(x, y, "o-", label=f"{label}: Brier {brier_score(predicted, own.good):.3f}")
        axes.set_xlabel("predicted")
        axes.set_title(f"{name}: {len(own.good)} poses, {100 * own.good.mean():.0f} % good")
        axes.legend(fontsize=8)
        axes.grid(color="0.9")
    figure.axes[0].set_ylabel(f"share of poses < {GOOD_MM:g} mm and < {GOOD_DEG:g} deg")
    save_figure(figure, file)
