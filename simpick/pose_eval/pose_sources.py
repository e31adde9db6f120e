"""Sources of pose estimates (an estimator, the oracle, a results file), and the loop that asks them."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from simpick.activity import counted
from simpick.assets.part import Part
from simpick.core_time import CoreTime, measured_core_time
from simpick.errors import ConfigError
from simpick.estimators.base import PoseEstimator
from simpick.estimators.boundary import onboard_part, validated_estimates
from simpick.estimators.oracle import OracleEstimator
from simpick.estimators.registry import ORACLE, EstimatorName, PoseBudget, load_estimator
from simpick.pose_eval.pose_images import PoseImage
from simpick.records import InstanceTruth, PoseEstimate


@dataclass(frozen=True, eq=False)
class Answer:
    """A source's estimates for one image."""

    image: PoseImage
    estimates: Sequence[PoseEstimate]
    estimation_s: float
    """Wall-clock time of all estimates, without preparation."""
    core_time: CoreTime = field(default_factory=CoreTime)
    """Meanwhile."""


class PoseSource(ABC):
    """Provides estimates for images."""

    @property
    def onboarding_s(self) -> Mapping[str, float]:
        """Return the wall-clock time of onboarding by part, which is small where templates were cached."""
        return {}

    def prepare(self, image: PoseImage) -> None:  # noqa: B027
        """Do what does not count as estimation time; nothing by default."""

    @abstractmethod
    def estimate(self, image: PoseImage) -> Sequence[PoseEstimate]:
        """Return estimates of the image's detections."""


def answers(images: Iterable[PoseImage], source: PoseSource) -> Iterator[Answer]:
    """Yield the source's answer to each image; only estimation is timed."""
    for image in images:
        source.prepare(image)
        start = time.perf_counter()
        with measured_core_time() as core_time:
            estimates = source.estimate(image)
        yield Answer(image, estimates, time.perf_counter() - start, core_time())


class EstimatorSource(PoseSource):
    """Runs an estimator; each part is onboarded before the first image with a detection of it."""

    def __init__(self, estimator: PoseEstimator, part_of: Callable[[str], Part]) -> None:
        self._estimator, self._part_of = estimator, part_of
        self._onboarding_s: dict[str, float] = {}

    @property
    def onboarding_s(self) -> Mapping[str, float]:
        """Return the wall-clock time of onboarding by part."""
        return self._onboarding_s

    def prepare(self, image: PoseImage) -> None:
        """Onboard new parts."""
        new = sorted({detection.part for detection in image.detections} - self._onboarding_s.keys())
        for name in counted(new, "preparing part"):
            start = time.perf_counter()
            onboard_part(self._estimator, self._part_of(name))
            self._onboarding_s[name] = time.perf_counter() - start

    def estimate(self, image: PoseImage) -> Sequence[PoseEstimate]:
        """Return the estimates of all detections, computed in one batch."""
        return validated_estimates(self._estimator, [image.frame], [image.detections])[0]


class OracleSource(PoseSource):
    """Returns the true poses of the detected instances."""

    def prepare(self, image: PoseImage) -> None:
        """Raise ConfigError unless all detections name the instance that they come from."""
        if any(detection.instance is None for detection in image.detections):
            raise ConfigError("the oracle needs detections that name instances: take perfect, realistic or box")

    def estimate(self, image: PoseImage) -> Sequence[PoseEstimate]:
        """Return the truth."""
        T_world_camera = image.frame.T_world_camera
        truths = [InstanceTruth(t.instance, t.part, T_world_camera @ t.T_camera_part, True) for t in image.truths]
        return OracleEstimator(lambda: truths).estimate(image.frame, image.detections)


class FileSource(PoseSource):
    """Returns the estimates of a results file, by scene and image."""

    def __init__(self, estimates: Mapping[tuple[int, int], Sequence[PoseEstimate]]) -> None:
        self._estimates = estimates

    def estimate(self, image: PoseImage) -> Sequence[PoseEstimate]:
        """Return the file's estimates for the image, which may be none."""
        return self._estimates.get((image.scene_id, image.im_id), [])


def make_source(
    name: str, part_of: Callable[[str], Part], hypotheses: int | None = None, budget: PoseBudget | None = None
) -> PoseSource:
    """Return the source of an estimator, ``NAME`` or ``NAME@K``; the oracle reads the annotations.

    K is the number of hypotheses to ask for, instead of `hypotheses`.

    Raises:
        UnknownNameError: no estimator has this name.
        ConfigError: it is neither NAME nor NAME@K, or a number of hypotheses or a budget that the estimator does not
            take; the oracle ignores both.
    """
    if EstimatorName.parse(name).name == ORACLE:
        return OracleSource()
    return EstimatorSource(load_estimator(name, hypotheses=hypotheses, budget=budget), part_of)
