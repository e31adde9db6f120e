"""The oracle noise sweep: grasp success against calibrated pose error."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from simpick.experiments.analysis.grasp_scores import GraspScores, score_grasps
from simpick.experiments.comparison import Comparison
from simpick.experiments.config import SweepConfig
from simpick.experiments.report.tables import share
from simpick.metrics.intervals import wilson_interval
from simpick.plotting import new_figure, save_figure
from simpick.terminal import Table, narrow_table


@dataclass(frozen=True)
class NoiseStep:
    """The scores at one level of noise."""

    unit: str
    """``mm`` for translation noise, ``deg`` for rotation noise."""
    noise: float
    """Median error that was added."""
    scores: GraspScores

    @property
    def interval(self) -> tuple[float, float]:
        """Return Wilson's 95 % interval of grasp success."""
        return wilson_interval(self.scores.grasp_success, self.scores.attempts)


def noise_steps(config: SweepConfig, comparison: Comparison) -> list[NoiseStep]:
    """Return the scores of each step of the sweep, from the comparison of its levels."""
    return [
        NoiseStep(unit, noise, score_grasps(r for r in comparison.results if r.mode == mode))
        for unit, noise, mode in config.steps()
    ]


def steps_table(steps: Sequence[NoiseStep]) -> Table:
    """Return the sweep as a table for the terminal."""
    columns = ("noise", "grasp success", "95 % interval", "clearance", "attempts")
    table = narrow_table(*columns, title="oracle with noise", padding=2)
    for step in steps:
        low, high = step.interval
        # One bin has no interval: its attempts are not independent.
        known = step.scores.attempts > 0 and step.scores.episodes > 1
        table.add_row(
            f"{step.noise:g} {step.unit}",
            share(step.scores.grasp_success),
            f"{low:.1%} to {high:.1%}" if known else "-",
            share(step.scores.clearance),
            str(step.scores.attempts),
        )
    return table


def steps_csv(steps: Sequence[NoiseStep]) -> str:
    """Return one line per step: unit, noise, attempts, grasp_success, clearance."""
    stream = io.StringIO()
    writer = csv.writer(stream)
    writer.writerow(["unit", "noise", "attempts", "grasp_success", "clearance"])
    for step in steps:
        scores = step.scores
        writer.writerow([step.unit, step.noise, scores.attempts, scores.grasp_success, scores.clearance])
    return stream.getvalue()


def plot_steps(steps: Sequence[NoiseStep], file: Path) -> None:
    """Draw grasp success with its interval against translation noise (left) and rotation noise (right)."""
    figure = new_figure(9, 3.6)
    axes = figure.subplots(1, 2, sharey=True)
    for axis, unit, label in zip(axes, ("mm", "deg"), ("translation", "rotation"), strict=True):
        chosen = sorted((s for s in steps if s.unit == unit), key=lambda s: s.noise)
        noise = [s.noise for s in chosen]
        low, high = zip(*(s.interval for s in chosen), strict=True) if chosen else ((), ())
        axis.fill_between(noise, low, high, alpha=0.2, linewidth=0)
        axis.plot(noise, [s.scores.grasp_success for s in chosen], marker="o", label="grasp success")
        axis.plot(noise, [s.scores.clearance for s in chosen], marker="s", linestyle="--", label="clearance")
        axis.set_xlabel(f"median {label} error [{unit}]")
        axis.set_ylim(0, 1.02)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("share")
    axes[0].legend(loc="lower left")
    figure.suptitle("Oracle poses with calibrated noise")
    save_figure(figure, file, dpi=150)
