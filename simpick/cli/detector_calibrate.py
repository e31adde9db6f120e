"""``simpick detector-calibrate``: fit what the learned detector judges instances by."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from simpick.cli.outputs import counted
from simpick.config import Config, PositiveInt


@dataclass(frozen=True)
class DetectorCalibrate(Config):
    """Fit what the learned detector judges instances by.

    That is how much asked parts, other objects and wrong masks resemble what is asked for. It is fitted on bins of
    random parts, so that library parts stay unseen. Run it again with new weights of the detector or of the pose
    network; to ship it, copy the file over estimators/detector/composition.json.
    """

    bins: PositiveInt = 25
    """Bins of random parts."""
    out: Path = Path("logs/composition.json")
    """The file to write."""
    overwrite: bool = False
    """Replace the file if it exists."""

    def run(self) -> int:
        """Fit and write."""
        # First, so that nothing is silent while libraries load.
        from simpick.terminal import Console

        console = Console()
        console.print_line(f"calibrating the detector on {counted(self.bins, 'random bin')}: {self.out}")
        import torch

        from simpick.errors import OutputError, SceneError
        from simpick.estimators.detector import LearnedDetector
        from simpick.pose_eval.benchmark_bins import load_view
        from simpick.pose_eval.detector_calibration import (
            calibration_bins,
            fit_composition,
            label_bin,
            write_composition,
        )
        from simpick.terminal import track, working

        if self.out.exists() and not self.overwrite:
            raise OutputError(f"{self.out} exists already. Choose another file with --out, or pass --overwrite.")
        torch.set_num_threads(1)
        detector, answers = LearnedDetector(), []
        for bin in track(calibration_bins(self.bins), "asking in random bins", console=console):
            try:
                view = load_view(bin)
            except SceneError as error:
                console.print_line(f"bin {bin.seed} is left out: {error}")
                continue
            answers += label_bin(detector, bin, view)
        with working("fitting", console):
            model = fit_composition(answers)
        provenance = {
            "made_by": f"simpick detector-calibrate --bins {self.bins}",
            "fitted_on": {"answers": len(answers), "instances": sum(len(known.shown) for known, _ in answers)},
        }
        write_composition(model, provenance, self.out)
        console.print(provenance)
        console.print_line(f"written to {self.out}")
        return 0
