"""``simpick detector-benchmark``: how well a detector finds and names library parts in fixed bins."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from simpick.config import Config, PositiveInt
from simpick.errors import ConfigError


@dataclass(frozen=True)
class DetectorBenchmark(Config):
    """Score a detector on the pose benchmark's bins.

    The figures are over instances of which at least 30 % are visible, with 95 % intervals over bins. In a mixed bin
    the detector is given all 28 parts that such bins are filled from.
    """

    detector: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="DETECTOR")] = "learned"
    """learned, or a detector of another package."""
    bins: Annotated[PositiveInt | None, tyro.conf.arg(metavar="INT", help_behavior_hint="(default: all 50)")] = None
    """How many bins to use, from the first."""
    look: Literal["default", "photo"] = "default"
    """photo: the same bins in the look of a photograph, as in simpick pose-benchmark."""
    weights: Annotated[Path | None, tyro.conf.arg(metavar="PATH", help_behavior_hint="(default: those that ship)")] = (
        None
    )
    """learned: weights of another training."""
    single: bool = False
    """Ask for one part at a time, in bins of other parts: three that the bin does not hold, two that it holds."""
    threads: PositiveInt = 2
    """Threads of the network."""

    def run(self) -> int:
        """Detect and print the table."""
        import torch

        from simpick.estimators.detections import find_detector
        from simpick.estimators.detector import LearnedDetector
        from simpick.pose_eval.benchmark_bins import benchmark_bins
        from simpick.pose_eval.detector_benchmark import detect_bins, figures_table
        from simpick.pose_eval.single_part_requests import answers_table, ask_for_single_parts
        from simpick.terminal import Console

        if self.weights is not None and self.detector != "learned":
            raise ConfigError(f"--weights are for the detector 'learned', got {self.detector!r}")
        torch.set_num_threads(self.threads)
        console = Console()
        make = find_detector(self.detector).make if self.weights is None else partial(LearnedDetector, self.weights)
        bins = benchmark_bins(self.bins, self.look)
        if self.single:
            console.print(answers_table(ask_for_single_parts(make, bins, console)))
        else:
            console.print(figures_table(detect_bins(make, bins, console)))
        return 0
