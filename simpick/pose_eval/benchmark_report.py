"""The yardstick's figures as tables for the terminal and as one JSON file."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from simpick.metrics.summaries import PoseSummary
from simpick.pose_eval.benchmark_bins import benchmark_bins
from simpick.pose_eval.benchmark_runs import PoseBenchmarkResult
from simpick.pose_eval.pose_evaluation import PoseEvaluation
from simpick.run_folder import RunFolder
from simpick.terminal import Table, narrow_table

YARDSTICK_FILE = "yardstick.json"
_ERRORS = ("deg", "mm", "depth %", "<5 deg", "<15 deg", "<30 deg")


def title(result: PoseBenchmarkResult) -> str:
    """Return who was measured on what; a part of the yardstick is called so."""
    count, whole = len(result.bins), len(benchmark_bins())
    bins = (
        f"the yardstick's {whole} bins" if count == whole else f"only the first {count} of the yardstick's {whole} bins"
    )
    mixed = sum(bin.kind == "mixed" for bin in result.bins)
    return f"{result.estimator} on {bins}\n{mixed} mixed, {count - mixed} homogeneous; fingerprint {result.fingerprint}"


def benchmark_table(result: PoseBenchmarkResult) -> Table:
    """Return one column for each preset of detections: counts, errors, recalls (misses count as wrong), AR and time."""
    columns: list[list[str]] = []
    for evaluation in result.evaluations.values():
        s = evaluation.summary
        time = f"{evaluation.ms_per_detection:.1f}"
        columns.append([f"{s.count}", f"{s.answered}", *_error_cells(s), *_recall_cells(evaluation), time])
    rows = (
        "targets",
        "answered",
        "rotation, median deg",
        "translation, median mm",
        "depth, median %",
        "turned < 5 deg, %",
        "turned < 15 deg, %",
        "turned < 30 deg, %",
        "AR, %",
        "AR VSD, %",
        "AR MSSD, %",
        "AR MSPD, %",
        "ms a detection",
    )
    return narrow_table("detections", *result.evaluations, title=title(result), rows=zip(rows, *columns, strict=True))


def visibility_tables(result: PoseBenchmarkResult) -> list[Table]:
    """Return errors and recalls by how much of the part is seen, a table for each preset of detections."""
    tables = []
    for noise, evaluation in result.evaluations.items():
        bands = evaluation.by_visibility.items()
        rows = [(band, f"{s.count}", f"{s.answered}", *_error_cells(s)) for band, s in bands if s.count]
        heading = f"{result.estimator} by visibility, {noise} detections"
        tables.append(narrow_table("visible", "targets", "answered", *_ERRORS, title=heading, rows=rows))
    return tables


def best_of_table(result: PoseBenchmarkResult) -> Table | None:
    """Return what the best of the first K hypotheses would be; None if the estimator makes none."""
    if not result.best_of:
        return None
    heading = f"{result.estimator}, best of its first K hypotheses: the one turned least against the truth"
    best_of = result.best_of.items()
    rows = [
        (noise, f"{k}", *_error_cells(s)) for noise in result.evaluations for (own, k), s in best_of if own == noise
    ]
    return narrow_table("detections", "K", *_ERRORS, title=heading, rows=rows)


def onboarding_line(result: PoseBenchmarkResult) -> str | None:
    """Return how long onboarding took, in words; None if there was nothing to onboard."""
    if not result.onboarding_s:
        return None
    total, count = sum(result.onboarding_s.values()), len(result.onboarding_s)
    return f"onboarding: {count} parts in {total:.1f} s, {total / count:.2f} s a part (less where cached before)"


class PoseBenchmarkStore(RunFolder):
    """A folder for one benchmark's figures: ``yardstick.json``, replaced as a whole after each estimator."""

    def __init__(self, path: Path, settings: dict[str, Any], *, overwrite: bool = False) -> None:
        """Take a folder, made if missing; `settings` are written beside the figures.

        Raises:
            OutputError: the folder cannot be written, holds other files, or holds figures and `overwrite` is not set.
        """
        super().__init__(path, None, config_file=YARDSTICK_FILE, overwrite=overwrite)
        self.file = path / YARDSTICK_FILE
        self._settings = settings
        self._results: list[dict[str, Any]] = []

    def add(self, result: PoseBenchmarkResult) -> None:
        """Add an estimator's figures and write the file."""
        self._results.append(to_json(result))
        content = {**self._settings, "results": self._results}
        self.write(YARDSTICK_FILE, json.dumps(_without_nan(content), indent=2, allow_nan=False) + "\n")


def to_json(result: PoseBenchmarkResult) -> dict[str, Any]:
    """Return all figures as plain values; recalls and averages of recalls as shares, unknown ones as NaN."""
    return {
        "estimator": result.estimator,
        "bins": len(result.bins),
        "whole": len(result.bins) == len(benchmark_bins()),
        "mixed": sum(bin.kind == "mixed" for bin in result.bins),
        "fingerprint": result.fingerprint,
        "onboarding_s": result.onboarding_s,
        "hypotheses": result.hypotheses,
        "detections": {
            noise: {
                **_figures(evaluation),
                "detections": evaluation.detections,
                "ms_per_detection": evaluation.ms_per_detection,
                "by_visibility": {band: dataclasses.asdict(s) for band, s in evaluation.by_visibility.items()},
                "by_bin": [dataclasses.asdict(figures) for figures in result.by_bin[noise]],
                "by_part": {
                    part: {"targets": r.targets, "ar": r.ar, "vsd": r.ar_vsd, "mssd": r.ar_mssd, "mspd": r.ar_mspd}
                    for part, r in evaluation.scores.by_part.items()
                },
                "best_of": {
                    str(k): dataclasses.asdict(s) for (preset, k), s in result.best_of.items() if preset == noise
                },
            }
            for noise, evaluation in result.evaluations.items()
        },
    }


def _figures(evaluation: PoseEvaluation) -> dict[str, Any]:
    r = evaluation.scores.overall
    recalls = {"ar": r.ar, "ar_vsd": r.ar_vsd, "ar_mssd": r.ar_mssd, "ar_mspd": r.ar_mspd}
    return {**dataclasses.asdict(evaluation.summary), **recalls}


def _without_nan(value: Any) -> Any:
    """Return the same plain values with None for NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {key: _without_nan(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_without_nan(inner) for inner in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def _error_cells(s: PoseSummary) -> list[str]:
    medians = (s.median_rotation_deg, s.median_translation_mm, s.median_depth_percent)
    recalls: Sequence[float] = (s.recall_5_deg, s.recall_15_deg, s.recall_30_deg)
    return [
        *("-" if math.isnan(value) else f"{value:.{1 if value >= 100 else 2}f}" for value in medians),
        *(f"{100 * share:.1f}" for share in recalls),
    ]


def _recall_cells(evaluation: PoseEvaluation) -> list[str]:
    r = evaluation.scores.overall
    return ["-" if value is None else f"{100 * value:.1f}" for value in (r.ar, r.ar_vsd, r.ar_mssd, r.ar_mspd)]
