"""Who answers an image: an estimator, the oracle, or a results file."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, runtime_checkable

from simpick.assets.part import Part
from simpick.errors import ConfigError
from simpick.estimators.base import PoseEstimator
from simpick.estimators.oracle import OracleEstimator
from simpick.estimators.registry import ORACLE, EstimatorName, PoseBudget, load_estimator
from simpick.pose_eval.pose_images import PoseImage
from simpick.records import InstanceTruth, PoseEstimate


@runtime_checkable
class PoseSource(Protocol):
    """Answers images with estimates."""

    def prepare(self, image: PoseImage) -> None:
        """Do what does not count as estimation time, such as making templates."""
        ...

    def estimate(self, image: PoseImage) -> Sequence[PoseEstimate]:
        """Return estimates of the image's detections."""
        ...


class EstimatorSource:
    """Runs an estimator; each part is onboarded before the first image with a detection of it."""

    def __init__(self, estimator: PoseEstimator, part_of: Callable[[str], Part]) -> None:
        self._estimator, self._part_of = estimator, part_of
        self.onboarding_s: dict[str, float] = {}
        """Wall-clock time by part; little where templates came from the cache."""

    def prepare(self, image: PoseImage) -> None:
        """Onboard the parts that are new."""
        for name in sorted({detection.part for detection in image.detections} - self.onboarding_s.keys()):
            start = time.perf_counter()
            self._estimator.onboard(self._part_of(name))
            self.onboarding_s[name] = time.perf_counter() - start

    def estimate(self, image: PoseImage) -> Sequence[PoseEstimate]:
        """Return the estimator's answers, all detections in one batch."""
        return self._estimator.estimate(image.frame, image.detections)


class OracleSource:
    """Answers with the true poses of the detections' instances."""

    def prepare(self, image: PoseImage) -> None:
        """Check that the detections say which instances they come from; raises ConfigError."""
        if any(detection.instance is None for detection in image.detections):
            raise ConfigError("the oracle needs detections made from annotations; leave out the detections file")

    def estimate(self, image: PoseImage) -> Sequence[PoseEstimate]:
        """Return the truth."""
        T_world_camera = image.frame.T_world_camera
        truths = [InstanceTruth(t.instance, t.part, T_world_camera @ t.T_camera_part, True) for t in image.truths]
        return OracleEstimator(lambda: truths).estimate(image.frame, image.detections)


class FileSource:
    """Answers with estimates that were made before, by scene and image."""

    def __init__(self, estimates: Mapping[tuple[int, int], Sequence[PoseEstimate]]) -> None:
        self._estimates = estimates

    def prepare(self, image: PoseImage) -> None:
        """Do nothing."""

    def estimate(self, image: PoseImage) -> Sequence[PoseEstimate]:
        """Return the file's estimates of the image; none if it has none."""
        return self._estimates.get((image.scene_id, image.im_id), [])


def make_source(
    name: str, part_of: Callable[[str], Part], hypotheses: int | None = None, budget: PoseBudget | None = None
) -> PoseSource:
    """Return the source behind an estimator's name, or ``NAME@K``; the oracle answers from the annotations.

    K is the number of hypotheses that it is asked for, instead of `hypotheses`.

    Raises:
        UnknownNameError: no estimator has this name.
        ConfigError: it is neither NAME nor NAME@K, or a number of hypotheses or a budget that the estimator does not
            take; the oracle ignores both.
    """
    if EstimatorName.parse(name).name == ORACLE:
        return OracleSource()
    return EstimatorSource(load_estimator(name, hypotheses=hypotheses, budget=budget), part_of)
