"""The oracle noise sweep: grasp success against calibrated pose error."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.table import Table

from simpick.experiments.analysis.grasp_scores import GraspScores, score_grasps
from simpick.experiments.episodes import validate
from simpick.experiments.provenance import run_identity
from simpick.experiments.result_store import ResultStore
from simpick.experiments.run_config import RunConfig
from simpick.experiments.runs import run_episodes
from simpick.metrics.intervals import wilson_interval


@dataclass(frozen=True)
class NoiseStep:
    """The scores at one level of noise."""

    unit: str
    """``mm`` for translation noise, ``deg`` for rotation noise."""
    noise: float
    """Median error that was added."""
    scores: GraspScores


def run_step(
    config: RunConfig, unit: str, noise: float, folder: Path, overwrite: bool, workers: int, console: Console
) -> NoiseStep:
    """Run the episodes of one level under ``folder/<unit>_<noise>``."""
    config = dataclasses.replace(config, **{f"noise_{unit}": noise})
    validate(config)
    store = ResultStore(folder / f"{unit}_{noise:g}", run_identity(config, [config]), overwrite=overwrite)
    run_episodes(config, store, record=False, workers=workers, console=console)
    return NoiseStep(unit, noise, score_grasps(store.results))


def steps_table(steps: Sequence[NoiseStep]) -> Table:
    """Return the sweep as a table for the terminal."""
    table = Table("noise", "grasp success", "95 % interval", "clearance", "attempts", title="oracle with noise")
    for step in steps:
        low, high = wilson_interval(step.scores.grasp_success, step.scores.attempts)
        table.add_row(
            f"{step.noise:g} {step.unit}",
            f"{step.scores.grasp_success:.1%}",
            f"{low:.1%} to {high:.1%}",
            f"{step.scores.clearance:.1%}",
            str(step.scores.attempts),
        )
    return table


def write_csv(steps: Sequence[NoiseStep], file: Path) -> None:
    """Write one line a step: unit, noise, attempts, grasp_success, clearance."""
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["unit", "noise", "attempts", "grasp_success", "clearance"])
        for step in steps:
            scores = step.scores
            writer.writerow([step.unit, step.noise, scores.attempts, scores.grasp_success, scores.clearance])


def plot_steps(steps: Sequence[NoiseStep], file: Path) -> None:
    """Draw grasp success with its interval against translation noise (left) and rotation noise (right)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 2, sharey=True)
    for axis, unit, label in zip(axes, ("mm", "deg"), ("translation", "rotation"), strict=True):
        chosen = sorted((s for s in steps if s.unit == unit), key=lambda s: s.noise)
        noise = [s.noise for s in chosen]
        success = [s.scores.grasp_success for s in chosen]
        bounds = [wilson_interval(s.scores.grasp_success, s.scores.attempts) for s in chosen]
        axis.fill_between(noise, [b[0] for b in bounds], [b[1] for b in bounds], alpha=0.2, linewidth=0)
        axis.plot(noise, success, marker="o", label="grasp success")
        axis.plot(noise, [s.scores.clearance for s in chosen], marker="s", linestyle="--", label="clearance")
        axis.set_xlabel(f"median {label} error [{unit}]")
        axis.set_ylim(0, 1.02)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("share")
    axes[0].legend(loc="lower left")
    figure.suptitle("Oracle poses with calibrated noise")
    figure.savefig(file, dpi=150)
