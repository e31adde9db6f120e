"""Scoring a source of estimates over images, with progress, and the table of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence

from simpick.metrics.scores import AverageRecalls
from simpick.pose_eval.pose_evaluation import PoseEvaluation, PoseEvaluator
from simpick.pose_eval.pose_images import PoseImage
from simpick.pose_eval.pose_sources import PoseSource
from simpick.records import PoseEstimate
from simpick.terminal import Console, Table, narrow_table, track


def score_images(
    images: Iterable[PoseImage],
    source: PoseSource,
    evaluator: PoseEvaluator,
    *,
    total: int | None = None,
    on_image: Callable[[PoseImage, Sequence[PoseEstimate], float], None] | None = None,
    console: Console | None = None,
) -> PoseEvaluation:
    """Estimate and score every image, and return the outcome; preparation is not part of the measured time.

    `on_image` is called with each image, its estimates and the seconds that they took.
    """
    for image in track(images, "images", total=total, console=console):
        source.prepare(image)
        start = time.perf_counter()
        estimates = source.estimate(image)
        elapsed_s = time.perf_counter() - start
        evaluator.add(image, estimates, elapsed_s)
        if on_image is not None:
            on_image(image, estimates, elapsed_s)
    return evaluator.result()


def recall_table(evaluation: PoseEvaluation, title: str) -> Table:
    """Return AR and its three terms per part and in all, as percentages."""
    rows = [(name, *_cells(recalls)) for name, recalls in evaluation.scores.by_part.items()]
    table = narrow_table("part", "targets", "AR", "VSD", "MSSD", "MSPD", title=title, rows=rows)
    table.add_section()
    table.add_row("all", *_cells(evaluation.scores.overall))
    return table


def summary_table(evaluation: PoseEvaluation) -> Table:
    """Return medians and recalls of all targets and of each visibility band."""
    columns = ("visible", "targets", "answered", "deg", "mm", "depth %", "<5 deg", "<15 deg", "<30 deg")
    table = narrow_table(*columns, title="medians and recalls")
    for name, s in {**evaluation.by_visibility, "all": evaluation.summary}.items():
        if s.count == 0:
            continue
        medians = f"{s.median_rotation_deg:.2f}", f"{s.median_translation_mm:.2f}", f"{s.median_depth_percent:.2f}"
        recalls = (f"{100 * share:.1f}" for share in (s.recall_5_deg, s.recall_15_deg, s.recall_30_deg))
        table.add_row(name, f"{s.count}", f"{s.answered}", *medians, *recalls)
    return table


def _cells(recalls: AverageRecalls) -> list[str]:
    values = (recalls.ar, recalls.ar_vsd, recalls.ar_mssd, recalls.ar_mspd)
    return [f"{recalls.targets}", *("-" if value is None else f"{100 * value:.1f}" for value in values)]
