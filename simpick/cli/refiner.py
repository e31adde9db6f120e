"""``simpick refiner``: from how far off does refinement find a pose, and how sure may one be of it?"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class RefinerBasin:
    """Plot the final error against the initial one: true poses are disturbed and refined, on yardstick bins."""

    bins: int = 5
    """How many of the yardstick's bins."""
    starts_deg: tuple[float, ...] = (5.0, 10.0, 20.0, 30.0, 45.0)
    """Initial rotation errors, about random axes."""
    depth_percent: float = 10.0
    """Initial depth errors are drawn evenly up to this."""
    seed: int = 0
    """Of the disturbances."""
    out: Path = Path("logs/refiner_basin.png")
    """The plot to write; one of that name is replaced."""

    def run(self) -> int:
        """Measure and plot."""
        from rich.console import Console

        from simpick.errors import ConfigError
        from simpick.estimators.refiner import Refiner
        from simpick.pose_eval.benchmark_bins import benchmark_bins, load_view
        from simpick.pose_eval.refiner_basin import measure_basin, plot_basin

        if not self.starts_deg or min(self.starts_deg) < 0 or max(self.starts_deg) > 180:
            raise ConfigError(f"starts_deg must be one or more angles between 0 and 180, got {self.starts_deg}")
        if not 0 <= self.depth_percent < 100:
            raise ConfigError(f"depth_percent must be between 0 and 100, got {self.depth_percent}")
        views = [load_view(bin) for bin in benchmark_bins(self.bins)]
        with Refiner() as refiner:
            points = measure_basin(views, refiner, self.starts_deg, self.depth_percent / 100, self.seed)
        plot_basin(points, self.out)
        Console().print(f"{len(points)} refinements: {self.out}", soft_wrap=True)
        return 0


@dataclass(frozen=True)
class RefinerCalibrate:
    """Fit the probability that a refined pose can be picked by, on bins of random parts; check it on library parts.

    The random parts are training parts, so that library parts stay unseen. Hypotheses come from `retrieval`: its five
    best together, and its best alone with its flips, as `refined` starts.
    """

    bins: int = 8
    """Bins of random parts to fit on, each with parts of its own."""
    parts: int = 4
    """Kinds of random parts in each bin."""
    count: int = 24
    """Instances in each bin."""
    check_bins: int = 10
    """Yardstick bins to check on."""
    out: Path = Path("logs/refiner_calibration")
    """Folder for confidence.json and reliability.png; files of these names are replaced."""

    def run(self) -> int:
        """Fit, check, write."""
        from rich.console import Console

        from simpick.estimators.refiner import RefinedEstimator
        from simpick.estimators.refiner.confidence import fit_confidence
        from simpick.estimators.retrieval import RetrievalConfig, RetrievalEstimator
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

        check = [load_view(bin) for bin in benchmark_bins(self.check_bins)]
        fit = [random_bin(k, self.parts, self.count) for k in range(self.bins)]
        fitted_on: dict[str, Outcomes] = {}
        held_out: dict[str, Outcomes] = {}
        for name, hypotheses in (("five hypotheses", 5), ("one, flipped too", 1)):
            estimator = RefinedEstimator(RetrievalEstimator(RetrievalConfig(hypotheses=hypotheses)))
            try:
                fitted_on[name] = outcomes(fit, estimator)
                held_out[name] = outcomes(check, estimator)
            finally:
                estimator.close()
        both = pooled(fitted_on.values())
        confidence = fit_confidence(both.features, both.good)

        def figures(own: Outcomes) -> dict[str, float]:
            return {
                "poses": len(own.good),
                "good_share": round(float(own.good.mean()), 4),
                "brier": round(brier_score(confidence.probability(own.features), own.good), 4),
                "brier_of_plain_scores": round(brier_score(own.plain_scores, own.good), 4),
            }

        provenance = {
            "made_by": f"simpick refiner calibrate --bins {self.bins} --parts {self.parts} --count {self.count} "
            f"--check-bins {self.check_bins}",
            "hypotheses_from": "retrieval",
            "fitted_on": {name: figures(own) for name, own in fitted_on.items()},
            "checked_on_yardstick": {name: figures(own) for name, own in held_out.items()},
        }
        write_confidence(confidence, provenance, self.out / "confidence.json")
        plot_reliability(held_out, confidence, self.out / "reliability.png")
        Console().print(provenance)
        Console().print(f"written to {self.out}", soft_wrap=True)
        return 0


@dataclass(frozen=True)
class RefinerCommand:
    """Look into the refiner: its basin of convergence, and how sure one may be of its poses."""

    action: (
        Annotated[RefinerBasin, tyro.conf.subcommand(name="basin", prefix_name=False)]
        | Annotated[RefinerCalibrate, tyro.conf.subcommand(name="calibrate", prefix_name=False)]
    )

    def run(self) -> int:
        """Run the chosen subcommand."""
        return self.action.run()
