"""`RefinedEstimator`: any estimator of several hypotheses, followed by the refiner."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence

from simpick.assets.part import Part
from simpick.estimators.base import PoseEstimator
from simpick.estimators.refiner.config import RefinerConfig
from simpick.estimators.refiner.refiner import Refiner
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis


class RefinedEstimator:
    """Refines all hypotheses of a base estimator and answers with the one that fits best. A `PoseEstimator`.

    Closable, because the refiner renders.
    """

    def __init__(self, base: PoseEstimator, config: RefinerConfig | None = None, *, mode: str = "refined") -> None:
        """Take hypotheses from `base`, which makes several or one; `mode` is the name in the estimates."""
        self.base, self.mode = base, mode
        self.refiner = Refiner(config)

    def onboard(self, part: Part) -> None:
        """Onboard the part at the base estimator and at the refiner."""
        self.base.onboard(part)
        self.refiner.onboard(part)

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return one estimate for each detection that the base answers, with refined hypotheses, best first.

        Raises:
            ConfigError: as the base estimator and `Refiner.refine`.
            UnknownNameError: a detection's part has not been onboarded.
        """
        start = time.perf_counter()
        estimates = [e for e in self.base.estimate(frame, detections) if e.detection is not None]
        if not estimates:
            return []
        answered = [e.detection for e in estimates if e.detection is not None]
        # Detections that the base left unanswered still hide others.
        unanswered = [d for d in detections if not any(d is known for known in answered)]
        hypotheses = [e.hypotheses or (PoseHypothesis(e.T_camera_part, e.score),) for e in estimates]
        refined = self.refiner.refine(frame, [*answered, *unanswered], [*hypotheses, *((),) * len(unanswered)])
        elapsed_s = (time.perf_counter() - start) / len(estimates)
        return [
            dataclasses.replace(
                estimate,
                T_camera_part=best_first[0].T_camera_part,
                score=best_first[0].score,
                mode=self.mode,
                elapsed_s=elapsed_s,
                hypotheses=best_first,
            )
            for estimate, best_first in zip(estimates, refined, strict=False)
        ]

    def close(self) -> None:
        """Free the refiner's OpenGL contexts; may be called again."""
        self.refiner.close()
