"""`RefinedEstimator`: any pose estimator, followed by the refiner."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence

from simpick.assets.part import Part
from simpick.estimators.base import PoseEstimator
from simpick.estimators.refiner.confidence import Confidence, confidence_features
from simpick.estimators.refiner.config import RefinerConfig
from simpick.estimators.refiner.flipped_starts import with_flips
from simpick.estimators.refiner.refiner import Refiner
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis


class RefinedEstimator:
    """Refines all hypotheses of a base estimator and returns the one that fits best. Implements `PoseEstimator`.

    A single hypothesis is also tried flipped, see `with_flips`; several are assumed to differ enough. `close` frees the
    refiner's OpenGL contexts.
    """

    def __init__(
        self,
        base: PoseEstimator,
        config: RefinerConfig | None = None,
        *,
        mode: str = "refined",
        confidence: Confidence | None = None,
    ) -> None:
        """Refine the hypotheses of `base`; `mode` is the name in the estimates.

        With `confidence`, an estimate's score is the probability that its pose is good enough to pick by; without, it
        is the refiner's own score.
        """
        self._confidence = confidence
        self.base, self.mode = base, mode
        self.refiner = Refiner(config)
        self._parts: dict[str, Part] = {}

    def onboard(self, part: Part) -> None:
        """Onboard the part at the base estimator and at the refiner."""
        self.base.onboard(part)
        self._parts[part.name] = part
        self.refiner.onboard(part)

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return one estimate per detection that the base answers, with refined hypotheses, best first.

        The hypotheses keep the refiner's scores, also where the estimate's score is a probability.

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
        hypotheses = [self._starts(e) for e in estimates]
        refined = self.refiner.refine(frame, [*answered, *unanswered], [*hypotheses, *((),) * len(unanswered)])
        scores = [self._score(best_first, detection) for best_first, detection in zip(refined, answered, strict=False)]
        elapsed_s = (time.perf_counter() - start) / len(estimates)
        return [
            dataclasses.replace(
                estimate,
                T_camera_part=best_first[0].T_camera_part,
                score=score,
                mode=self.mode,
                elapsed_s=elapsed_s,
                hypotheses=best_first,
            )
            for estimate, best_first, score in zip(estimates, refined, scores, strict=False)
        ]

    def _starts(self, estimate: PoseEstimate) -> Sequence[PoseHypothesis]:
        """Return the base's hypotheses, and flips of a single one if its part has been onboarded."""
        own = list(estimate.hypotheses) or [PoseHypothesis(estimate.T_camera_part, estimate.score)]
        part = self._parts.get(estimate.part)
        return own if len(own) > 1 or part is None else with_flips(own[0], part)

    def _score(self, best_first: Sequence[PoseHypothesis], detection: Detection) -> float:
        if self._confidence is None:
            return best_first[0].score
        return float(self._confidence.probability(confidence_features(best_first, visible_px(detection))))

    def close(self) -> None:
        """Free the refiner's OpenGL contexts; may be called repeatedly."""
        self.refiner.close()


def visible_px(detection: Detection) -> int:
    """Return the mask's pixels, or the box's where there is no mask."""
    if detection.mask is not None:
        return int(detection.mask.sum())
    sides = detection.box_xyxy_px[2:] - detection.box_xyxy_px[:2]
    return int(sides[0] * sides[1])
