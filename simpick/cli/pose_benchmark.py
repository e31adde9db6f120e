"""``simpick yardstick``: how good are an estimator's poses on the fixed bins that every estimator is measured on?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro


@dataclass(frozen=True)
class Yardstick:
    """Measure pose estimators on 50 fixed bins of library parts: 30 mixed, 20 of one part each, seen from above.

    They hold 12 to 50 parts. The first run simulates and renders them, which takes minutes, and keeps what the camera
    saw. For each estimator, tables of errors, recalls and time; of the same by visibility; and of its hypotheses.
    """

    estimators: tyro.conf.Positional[tuple[str, ...]] = ("oracle",)
    """Who estimates poses: oracle, retrieval, another that ships, or one that a package registers; NAME@K asks it for K
    hypotheses. Several are told apart in order, each from the one before."""
    noise: tuple[Literal["perfect", "realistic"], ...] = ("perfect", "realistic")
    """How well parts are segmented before their poses are estimated; each gets its own figures."""
    bins: int | None = None
    """Only the first so many bins: a quick look, not the yardstick's figures."""
    hypotheses: int | None = None
    """Ask for this many hypotheses instead of the estimator's own number; more take longer. The oracle has none."""
    iterations: int | None = None
    """Of coarse and fine: how often they take templates around their own estimate, instead of their own number."""
    steps: int | None = None
    """Of coarse and fine: denoising steps of an answer, instead of their own number."""
    workers: int = 1
    """Bins to work on at the same time, each in a process of its own; times of estimates suffer from it."""
    out: Path | None = None
    """Folder to write all figures to, as yardstick.json."""
    overwrite: bool = False
    """Replace the figures that are in `out` already."""

    def run(self) -> int:
        """Measure one estimator after another and print its tables."""
        import time

        from rich.console import Console

        from simpick.assets.library import get_part
        from simpick.errors import ConfigError
        from simpick.estimators.registry import PoseBudget
        from simpick.pose_eval.benchmark_bins import benchmark_bins
        from simpick.pose_eval.benchmark_gains import gains, gains_table
        from simpick.pose_eval.benchmark_report import (
            PoseBenchmarkStore,
            benchmark_table,
            best_of_table,
            onboarding_line,
            visibility_tables,
        )
        from simpick.pose_eval.benchmark_runs import make_views, run_pose_benchmark
        from simpick.pose_eval.pose_sources import make_source

        bins = benchmark_bins(self.bins)
        if not self.estimators:
            raise ConfigError("name one estimator or more, such as: simpick yardstick oracle retrieval")
        if self.workers < 1:
            raise ConfigError(f"workers must be 1 or more, got {self.workers}")
        budget = PoseBudget(self.iterations, self.steps)
        # Before any bin is made or file is written, so that a wrong name costs nothing.
        for estimator in self.estimators:
            make_source(estimator, get_part, self.hypotheses, budget)
        settings = {
            "workers": self.workers,
            "hypotheses_asked_for": self.hypotheses,
            "iterations_asked_for": self.iterations,
            "steps_asked_for": self.steps,
        }
        store = None if self.out is None else PoseBenchmarkStore(self.out, settings, overwrite=self.overwrite)
        console = Console()
        start = time.perf_counter()
        if made := make_views(bins, workers=self.workers, console=console):
            console.print(f"{made} bins made in {time.perf_counter() - start:.0f} s; they are kept for the next time")
        results = []
        for estimator in self.estimators:
            start = time.perf_counter()
            result = run_pose_benchmark(
                estimator,
                noises=self.noise,
                bins=self.bins,
                hypotheses=self.hypotheses,
                budget=budget,
                workers=self.workers,
                console=console,
            )
            elapsed_s = time.perf_counter() - start
            for table in (benchmark_table(result), *visibility_tables(result), best_of_table(result)):
                if table is not None:
                    console.print(table)
            if line := onboarding_line(result):
                console.print(line)
            at_once = f", {self.workers} bins at once" if self.workers > 1 else ""
            asked = f"; {self.hypotheses} hypotheses were asked for" if self.hypotheses and result.hypotheses else ""
            console.print(f"estimated and scored in {elapsed_s:.0f} s{at_once}{asked}")
            if store is not None:
                store.add(result)
                console.print(f"figures: {store.file}")
            results.append(result)
        if (table := gains_table(gains(results))) is not None:
            console.print(table)
        return 0
