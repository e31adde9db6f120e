"""``simpick refiner``: the refiner's basin of convergence and the calibration of its confidence."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from annotated_types import Interval, MinLen

from simpick.cli.outputs import check_image, counted
from simpick.config import Config, PositiveInt


@dataclass(frozen=True)
class RefinerBasin(Config):
    """Plot the final against the initial error of refined poses.

    True poses on bins of the pose benchmark are disturbed and refined.
    """

    bins: PositiveInt = 5
    """How many bins of the pose benchmark to use, from the first."""
    starts_deg: Annotated[tuple[Annotated[float, Interval(ge=0, le=180)], ...], MinLen(1)] = (5, 10, 20, 30, 45)
    """Initial rotation errors in degrees, about random axes."""
    depth_percent: Annotated[float, Interval(ge=0, lt=100)] = 10.0
    """Largest initial depth error, in percent; errors are drawn uniformly up to it."""
    seed: int = 0
    """Seed of the disturbances."""
    out: Path = Path("logs/refiner_basin.png")
    """The plot to write."""
    overwrite: bool = False
    """Replace the plot if it exists."""

    def run(self) -> int:
        """Measure and plot."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line(f"refining from known offsets in {counted(self.bins, 'bin')}: {self.out}")
        from simpick.estimators.refiner import Refiner
        from simpick.pose_eval.benchmark_bins import benchmark_bins, load_view
        from simpick.pose_eval.refiner_basin import measure_basin, plot_basin
        from simpick.terminal import track

        check_image(self.out, overwrite=self.overwrite)
        views = [load_view(bin) for bin in track(benchmark_bins(self.bins), "making bins", console=console)]
        with Refiner() as refiner:
            shown = track(views, "refining from known offsets", console=console)
            points = measure_basin(shown, refiner, self.starts_deg, self.depth_percent / 100, self.seed)
        plot_basin(points, self.out)
        console.print_line(f"{len(points)} refinements: {self.out}")
        return 0


@dataclass(frozen=True)
class RefinerCalibrate(Config):
    """Fit the probability that a refined pose can be picked by.

    It is fitted on bins of random parts, so that library parts stay unseen, and checked on library parts. To ship it,
    copy confidence.json over estimators/refiner/confidence.json.
    """

    detections: Annotated[tuple[str, ...], MinLen(1), tyro.conf.arg(metavar="NAME ...")] = ("learned",)
    """Detections to fit on and to check with; each bin is used with all of them."""
    starts: Annotated[tuple[str, ...], MinLen(1), tyro.conf.arg(metavar="ESTIMATOR ...")] = (
        "retrieval@5",
        "retrieval@1",
        "fine",
    )
    """Estimators whose poses are refined; a single hypothesis is also tried flipped."""

    bins: PositiveInt = 8
    """Bins of random parts to fit on, each with its own parts."""
    parts: PositiveInt = 4
    """Kinds of random parts per bin."""
    count: Annotated[tuple[PositiveInt, ...], MinLen(1), tyro.conf.arg(metavar="INT ...")] = (24,)
    """Instances per bin, in turn; several numbers, so that full and nearly empty bins count."""
    rest_only: bool = False
    """Fit only the bias and the weight of resting on the floor; the image's cues keep the weights that are shipped."""
    check_bins: PositiveInt = 10
    """How many bins of the pose benchmark to check on, from the first."""
    out: Path = Path("logs/refiner_calibration")
    """Folder for confidence.json and reliability.png."""
    overwrite: bool = False
    """Replace these files if they exist."""

    def run(self) -> int:
        """Fit, check, write."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line(f"fitting the refiner's confidence on {counted(self.bins, 'random bin')}: {self.out}")
        from simpick.estimators.detections import detector_data
        from simpick.estimators.refiner import RefinedEstimator
        from simpick.estimators.refiner.confidence import FEATURES, Confidence, fit_confidence, read_confidence
        from simpick.estimators.registry import load_estimator
        from simpick.pose_eval.benchmark_bins import benchmark_bins, load_view
        from simpick.pose_eval.refiner_calibration import (
            Outcomes,
            brier_score,
            outcomes,
            plot_reliability,
            pooled,
            random_bin,
            write_confidence,
        )
        from simpick.terminal import track

        check_image(self.out / "reliability.png", overwrite=self.overwrite)
        # Before any bin is made, so that a wrong name costs no time. The shipped weights may be damaged, or of other
        # cues: they are what is made again here.
        shipped = read_confidence() if self.rest_only else None
        unused = Confidence(0.0, (0.0,) * len(FEATURES))
        estimators = {name: RefinedEstimator(load_estimator(name), confidence=unused) for name in self.starts}
        for name in self.detections:
            detector_data(name)
        check = [load_view(bin) for bin in track(benchmark_bins(self.check_bins), "making bins", console=console)]
        numbers = track(range(self.bins), "random bins", console=console)
        fit = [random_bin(k, self.parts, self.count[k % len(self.count)]) for k in numbers]
        fitted_on: dict[str, Outcomes] = {}
        held_out: dict[str, Outcomes] = {}
        for name, estimator in estimators.items():
            try:
                for views, own, kind in ((fit, fitted_on, "random bins"), (check, held_out, "bins to check on")):
                    shown = track(views, f"refining the poses of {name}, {kind}", console=console)
                    own[name] = outcomes(shown, estimator, self.detections)
            finally:
                estimator.close()
        every = pooled(fitted_on.values())
        confidence = fit_confidence(every.features, every.good, image_weights_of=shipped)
        answered = {name: own.best(confidence) for name, own in held_out.items()}

        def figures(own: Outcomes) -> dict[str, float]:
            return {
                "poses": len(own.good),
                "good_share": round(float(own.good.mean()), 4),
                "brier": round(brier_score(confidence.probability(own.features), own.good), 4),
            }

        provenance = {
            "made_by": f"simpick refiner calibrate --bins {self.bins} --parts {self.parts} "
            f"--count {' '.join(map(str, self.count))} "
            f"--check-bins {self.check_bins} --detections {shlex.join(self.detections)} "
            f"--starts {shlex.join(self.starts)}{' --rest-only' if self.rest_only else ''}",
            "fitted_on": {name: figures(own) for name, own in fitted_on.items()},
            "checked_on_pose_benchmark": {name: figures(own) for name, own in answered.items()},
        }
        write_confidence(confidence, provenance, self.out / "confidence.json")
        plot_reliability(answered, confidence, self.out / "reliability.png")
        console.print(provenance)
        console.print_line(f"written to {self.out}")
        return 0
