"""Tables of pose scores: recalls per part, and errors by visibility."""

from __future__ import annotations

import math

from simpick.metrics.scores import AverageRecalls
from simpick.metrics.summaries import PoseSummary
from simpick.pose_eval.pose_evaluation import PoseEvaluation
from simpick.terminal import Table, narrow_table

ERRORS = ("deg", "mm", "depth %", "<5 deg", "<15 deg", "<30 deg")
"""Headings of `error_cells`."""


def recall_table(evaluation: PoseEvaluation, title: str) -> Table:
    """Return AR and its three terms per part and overall, as percentages; without VSD, AR is that of the other two."""
    overall = evaluation.scores.overall
    heading = "AR" if overall.ar is not None else "AR of 2"

    def row(name: str, recalls: AverageRecalls) -> tuple[str, ...]:
        return (name, f"{recalls.targets}", f"{100 * recalls.ar_computed:.1f}", *recall_cells(recalls)[1:])

    rows = [row(name, recalls) for name, recalls in evaluation.scores.by_part.items()]
    table = narrow_table("part", "targets", heading, "VSD", "MSSD", "MSPD", title=title, rows=rows)
    table.add_section()
    table.add_row(*row("all", overall))
    return table


def visibility_table(evaluation: PoseEvaluation, title: str, *, total: bool = False) -> Table:
    """Return medians and recalls per visibility band, and with `total` of all targets."""
    bands = evaluation.by_visibility | ({"all": evaluation.summary} if total else {})
    rows = [(band, f"{s.count}", f"{s.answered}", *error_cells(s)) for band, s in bands.items() if s.count]
    return narrow_table("visible", "targets", "answered", *ERRORS, title=title, rows=rows)


def error_cells(s: PoseSummary) -> list[str]:
    """Return median errors and recalls (misses count as wrong) as text."""
    medians = (s.median_rotation_deg, s.median_translation_mm, s.median_depth_percent)
    recalls = (s.recall_5_deg, s.recall_15_deg, s.recall_30_deg)
    return [
        *("-" if math.isnan(value) else f"{value:.{1 if value >= 100 else 2}f}" for value in medians),
        *(f"{100 * share:.1f}" for share in recalls),
    ]


def recall_cells(recalls: AverageRecalls) -> list[str]:
    """Return AR and its three terms as percentages."""
    values = (recalls.ar, recalls.ar_vsd, recalls.ar_mssd, recalls.ar_mspd)
    return ["-" if value is None else f"{100 * value:.1f}" for value in values]
