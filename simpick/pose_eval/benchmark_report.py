"""The pose benchmark's figures as tables for the terminal and as one JSON file."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

from simpick.pose_eval.benchmark_bins import benchmark_bins
from simpick.pose_eval.benchmark_runs import PoseBenchmarkResult
from simpick.pose_eval.pose_evaluation import PoseEvaluation
from simpick.pose_eval.tables import ERRORS, error_cells, recall_cells, visibility_table
from simpick.run_folder import RunFolder
from simpick.terminal import Table, narrow_table

FIGURES_FILE = "yardstick.json"
_ROWS = (
    "targets",
    "answered",
    "rotation, median deg",
    "translation, median mm",
    "depth, median %",
    "rotation error < 5 deg, %",
    "rotation error < 15 deg, %",
    "rotation error < 30 deg, %",
    "AR, %",
    "AR VSD, %",
    "AR MSSD, %",
    "AR MSPD, %",
    "ms per detection",
    "waiting for a core, %",
)


def title(result: PoseBenchmarkResult) -> str:
    """Return the estimator, the bins, their look and their fingerprint; figures of only some bins are labelled so."""
    count, whole = len(result.bins), len(benchmark_bins())
    bins = f"all {whole} bins" if count == whole else f"only the first {count} of {whole} bins"
    mixed = sum(bin.kind == "mixed" for bin in result.bins)
    kinds = f"{mixed} mixed, {count - mixed} homogeneous"
    look = "\nin the look of a photograph" if result.look == "photo" else ""
    return f"{result.estimator} on the pose benchmark\n{bins}\n{kinds}{look}\nfingerprint {result.fingerprint}"


def benchmark_table(result: PoseBenchmarkResult) -> Table:
    """Return one column per detection preset: counts, errors, recalls (misses count as wrong), AR and time."""
    columns = []
    for evaluation in result.evaluations.values():
        s, waiting = evaluation.summary, f"{100 * evaluation.core_time.waiting:.0f}"
        times = f"{evaluation.ms_per_detection:.1f}", waiting
        columns.append(
            (f"{s.count}", f"{s.answered}", *error_cells(s), *recall_cells(evaluation.scores.overall), *times)
        )
    rows = zip(_ROWS, *columns, strict=True)
    return narrow_table("detections", *result.evaluations, title=title(result), rows=rows)


def visibility_tables(result: PoseBenchmarkResult) -> list[Table]:
    """Return errors and recalls by visibility, one table per detection preset."""
    return [
        visibility_table(evaluation, f"{result.estimator} by visibility, {preset} detections")
        for preset, evaluation in result.evaluations.items()
    ]


def best_of_table(result: PoseBenchmarkResult) -> Table | None:
    """Return the errors of the best of the first K hypotheses; None if the estimator makes none."""
    if not result.best_of:
        return None
    heading = f"{result.estimator}, best of its first K hypotheses, by rotation error"
    rows = [(preset, f"{k}", *error_cells(s)) for (preset, k), s in result.best_of.items()]
    return narrow_table("detections", "K", *ERRORS, title=heading, rows=rows)


def onboarding_line(result: PoseBenchmarkResult) -> str | None:
    """Return the time of onboarding as text; None if there was nothing to onboard."""
    if not result.onboarding_s:
        return None
    total, count = sum(result.onboarding_s.values()), len(result.onboarding_s)
    return f"onboarding: {count} parts in {total:.1f} s, {total / count:.2f} s per part (less where cached)"


class PoseBenchmarkStore(RunFolder):
    """A folder for one benchmark's figures: ``yardstick.json``, replaced as a whole after each estimator."""

    def __init__(self, path: Path, settings: dict[str, Any], *, overwrite: bool = False) -> None:
        """Open a folder, made if missing; `settings` are written beside the figures.

        Raises:
            OutputError: the folder cannot be written, holds other files, or holds figures and `overwrite` is not set.
        """
        super().__init__(path, None, config_file=FIGURES_FILE, overwrite=overwrite)
        self.file = path / FIGURES_FILE
        self._settings = settings
        self._results: list[dict[str, Any]] = []

    def add(self, result: PoseBenchmarkResult) -> None:
        """Add an estimator's figures and write the file."""
        self._results.append(to_json(result))
        content = {**self._settings, "results": self._results}
        self.write(FIGURES_FILE, json.dumps(_without_nan(content), indent=2, allow_nan=False) + "\n")


def to_json(result: PoseBenchmarkResult) -> dict[str, Any]:
    """Return all figures as plain values; recalls and averages of recalls as fractions, unknown ones as NaN."""
    return {
        "estimator": result.estimator,
        "bins": len(result.bins),
        "whole": len(result.bins) == len(benchmark_bins()),
        "mixed": sum(bin.kind == "mixed" for bin in result.bins),
        "look": result.look,
        "fingerprint": result.fingerprint,
        "onboarding_s": result.onboarding_s,
        "hypotheses": result.hypotheses,
        "detections": {
            preset: {
                **_figures(evaluation),
                "detections": evaluation.detections,
                "ms_per_detection": evaluation.ms_per_detection,
                "waiting_for_a_core": evaluation.core_time.waiting,
                "by_visibility": {band: dataclasses.asdict(s) for band, s in evaluation.by_visibility.items()},
                "by_bin": [dataclasses.asdict(figures) for figures in result.by_bin[preset]],
                "by_part": {
                    part: {"targets": r.targets, "ar": r.ar, "vsd": r.ar_vsd, "mssd": r.ar_mssd, "mspd": r.ar_mspd}
                    for part, r in evaluation.scores.by_part.items()
                },
                "best_of": {str(k): dataclasses.asdict(s) for (own, k), s in result.best_of.items() if own == preset},
            }
            for preset, evaluation in result.evaluations.items()
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
