"""`RefinedEstimator`: any pose estimator, followed by the refiner."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence

from simpick.assets.part import Part
from simpick.estimators.base import PoseEstimator
from simpick.estimators.refiner.box_masks import BoxMasks
from simpick.estimators.refiner.confidence import Confidence
from simpick.estimators.refiner.config import RefinerConfig
from simpick.estimators.refiner.flipped_starts import with_flips
from simpick.estimators.refiner.refiner import Finalist, Refiner
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis


class RefinedEstimator:
    """Refines all hypotheses of a base estimator and returns the most probable pose. Implements `PoseEstimator`.

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
        """Refine the hypotheses of `base`; `mode` is the name in the estimates, `confidence` as in `Refiner`."""
        self.base, self.mode = base, mode
        self.refiner = Refiner(config, confidence)
        self._box_masks = BoxMasks()
        self._parts: dict[str, Part] = {}

    def onboard(self, part: Part) -> None:
        """Onboard the part at the base estimator and at the refiner."""
        self.base.onboard(part)
        self._parts[part.name] = part
        self.refiner.onboard(part)

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return one estimate per detection that the base answers, with refined hypotheses, best first.

        Scores are probabilities that a pose is good enough to pick by. A detection without a mask gets one from the
        image or the base's poses (`BoxMasks`); the estimates keep the detections as they were given.

        Raises:
            ConfigError: as the base estimator and `Refiner.refine`.
            UnknownNameError: a detection's part has not been onboarded.
        """
        start = time.perf_counter()
        estimates, asked, hypotheses = self._started(frame, detections)
        refined = self.refiner.refine(frame, asked, hypotheses)
        elapsed_s = (time.perf_counter() - start) / max(len(estimates), 1)
        return [
            _answer(estimate, best_first, self.mode, elapsed_s)
            for estimate, best_first in zip(estimates, refined, strict=False)
        ]

    def finalists(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[tuple[Detection, list[Finalist]]]:
        """Return the poses among which `estimate` chooses, for each detection whose poses are refined."""
        _, asked, hypotheses = self._started(frame, detections)
        found = self.refiner.finalists(frame, asked, hypotheses)
        return [(detection, own) for detection, own in zip(asked, found, strict=True) if own is not None]

    def close(self) -> None:
        """Free the OpenGL contexts; may be called repeatedly."""
        self.refiner.close()
        self._box_masks.close()

    def _started(
        self, frame: CameraFrame, detections: Sequence[Detection]
    ) -> tuple[list[PoseEstimate], list[Detection], list[Sequence[PoseHypothesis]]]:
        """Return the base's estimates, then all detections, the answered ones first, and where each begins."""
        estimates = [e for e in self.base.estimate(frame, detections) if e.detection is not None]
        answered = [e.detection for e in estimates if e.detection is not None]
        # Detections that the base left unanswered still hide others.
        unanswered = [d for d in detections if not any(d is known for known in answered)]
        asked = [*self._box_masks.masked(frame, estimates, self._parts), *unanswered]
        return estimates, asked, [*map(self._starts, estimates), *((),) * len(unanswered)]

    def _starts(self, estimate: PoseEstimate) -> Sequence[PoseHypothesis]:
        """Return the base's hypotheses, and flips of a single one if its part has been onboarded."""
        own = list(estimate.hypotheses) or [PoseHypothesis(estimate.T_camera_part, estimate.score)]
        part = self._parts.get(estimate.part)
        return own if len(own) > 1 or part is None else with_flips(own[0], part)


def _answer(
    estimate: PoseEstimate, best_first: tuple[PoseHypothesis, ...], mode: str, elapsed_s: float
) -> PoseEstimate:
    best = best_first[0]
    return dataclasses.replace(
        estimate,
        T_camera_part=best.T_camera_part,
        score=best.score,
        mode=mode,
        elapsed_s=elapsed_s,
        hypotheses=best_first,
    )
