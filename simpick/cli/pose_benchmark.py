"""``simpick pose-benchmark``: the accuracy of pose estimators on fixed bins, the same for every estimator."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from annotated_types import MinLen

from simpick.config import Config, PositiveInt

_ESTIMATORS_OWN = "(default: the estimator's own)"


@dataclass(frozen=True)
class PoseBenchmark(Config):
    """Score pose estimators on 50 fixed bins of library parts.

    30 bins are mixed and 20 hold one kind of part, 12 to 50 parts each, seen from above. The first run simulates and
    renders them, which takes minutes, and caches the images. For each estimator, tables report errors, recalls and
    time, the same by visibility, and the best of its hypotheses. Several estimators are compared, each with its
    predecessor.
    """

    estimators: Annotated[tuple[str, ...], MinLen(1), tyro.conf.Positional, tyro.conf.arg(metavar="ESTIMATOR ...")] = (
        "refined",
    )
    """retrieval, coarse, fine, refined, retrieval_refined, another package's, or oracle; NAME@K: K hypotheses."""
    detections: Annotated[tuple[str, ...], MinLen(1), tyro.conf.arg(metavar="NAME ...")] = ("learned", "perfect")
    """learned (found in the image), another, FILE.json of BOP, or simulated: perfect (upper bound), realistic, box."""
    look: Literal["default", "photo"] = "default"
    """photo: the same bins lit from one side, with blur, noise, JPEG and other colours, like photographs."""
    bins: Annotated[PositiveInt | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(default: all 50)")] = None
    """How many bins to use, from the first; only all 50 give the benchmark's figures."""
    hypotheses: Annotated[PositiveInt | None, tyro.conf.arg(metavar="INT", help_behavior_hint=_ESTIMATORS_OWN)] = None
    """How many hypotheses to ask for per detection; the oracle has none."""
    iterations: Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint=_ESTIMATORS_OWN)] = None
    """coarse and fine: how many times templates are chosen around the estimator's own answer."""
    decoder: Annotated[int | None, tyro.conf.arg(metavar="STEPS", help_behavior_hint="(default: 0, off)")] = None
    """coarse and fine: denoise each answer with the diffusion decoder, in this many steps (3 is enough)."""
    workers: PositiveInt = 1
    """Bins to process at the same time, each in its own process; estimates take longer then."""
    export: Annotated[Path | None, tyro.conf.arg(metavar="DIR", help_behavior_hint="(default: poses are scored)")] = (
        None
    )
    """Only write the bins to this folder as a BOP data set, for a detector that writes a FILE.json."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="(default: no file is written)")] = (
        None
    )
    """Folder for yardstick.json, which holds all figures."""
    overwrite: bool = False
    """Replace the figures in the folder --out."""

    def run(self) -> int:
        """Score one estimator after the other and print its tables."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        if self.export is None:
            console.print_line(
                f"pose benchmark of {', '.join(self.estimators)} with {', '.join(self.detections)} detections"
            )
        import time

        from simpick.assets.library import get_part
        from simpick.core_time import disturbance_lines
        from simpick.estimators.detections import detector_data, is_file
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
        from simpick.pose_eval.benchmark_runs import export_bins, make_views, run_pose_benchmark
        from simpick.pose_eval.file_detections import check_covers
        from simpick.pose_eval.pose_sources import make_source

        bins = benchmark_bins(self.bins, self.look)
        if self.export is not None:
            export_bins(bins, self.export, console)
            return 0
        budget = PoseBudget(self.iterations, self.decoder)
        # Before any bin is made or file is written, so that a wrong name costs nothing.
        for estimator in self.estimators:
            make_source(estimator, get_part, self.hypotheses, budget)
        for name in self.detections:
            detector_data(name)
            if is_file(name):
                check_covers(Path(name), [bin.seed for bin in bins])
        settings = {
            "look": self.look,
            "workers": self.workers,
            "hypotheses_asked_for": self.hypotheses,
            "iterations_asked_for": self.iterations,
            "decoder_steps_asked_for": self.decoder,
        }
        store = None if self.out is None else PoseBenchmarkStore(self.out, settings, overwrite=self.overwrite)
        start = time.perf_counter()
        if made := make_views(bins, workers=self.workers, console=console):
            console.print(f"{made} bins made and cached in {time.perf_counter() - start:.0f} s")
        results = []
        for estimator in self.estimators:
            start = time.perf_counter()
            result = run_pose_benchmark(
                estimator,
                detections=self.detections,
                bins=self.bins,
                look=self.look,
                hypotheses=self.hypotheses,
                budget=budget,
                workers=self.workers,
                console=console,
            )
            elapsed_s = time.perf_counter() - start
            for table in (benchmark_table(result), *visibility_tables(result), best_of_table(result)):
                if table is not None:
                    console.print(table)
            for line in disturbance_lines({name: e.core_time for name, e in result.evaluations.items()}):
                console.print_line(line)
            if line := onboarding_line(result):
                console.print(line)
            at_once = f", {self.workers} bins at once" if self.workers > 1 else ""
            asked = f"; {self.hypotheses} hypotheses were asked for" if self.hypotheses and result.hypotheses else ""
            console.print(f"estimated and scored in {elapsed_s:.0f} s{at_once}{asked}")
            if store is not None:
                store.add(result)
                console.print_line(f"figures: {store.file}")
            results.append(result)
        if (table := gains_table(gains(results))) is not None:
            console.print(table)
        return 0
