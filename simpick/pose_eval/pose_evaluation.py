"""Scoring pose estimates image by image: BOP's average recalls, medians, and both by visibility."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from simpick.errors import ConfigError
from simpick.metrics.matching import greedy_matches, top_estimates, valid_truths
from simpick.metrics.pose_errors import batch_pose_errors, mssd
from simpick.metrics.scores import DepthImages, PoseScores, TargetErrors, pose_scores, target_errors
from simpick.metrics.summaries import VISIBILITY_BANDS, PoseSummary, summarize, summarize_by_visibility
from simpick.metrics.visible_surface import VSD_DELTA_M
from simpick.pose_eval.pose_images import PoseImage, PoseModel, PoseTruth
from simpick.pose_eval.posed_depth import PosedDepthRenderer
from simpick.records import PoseError, PoseEstimate


@dataclass(frozen=True, eq=False)
class InstanceError:
    """How one instance that was to be found was answered."""

    error: PoseError | None
    """None without an answer."""
    visible_fraction: float
    depth_m: float
    """True depth of the part's origin along the optical axis."""


@dataclass(frozen=True, eq=False)
class ImageErrors:
    """All that is kept of one image with its estimates."""

    targets: tuple[TargetErrors, ...]
    """One a part."""
    instances: tuple[InstanceError, ...]
    """All that were to be found."""
    detections: int
    estimation_s: float
    """Wall-clock time of the image's estimates."""


@dataclass(frozen=True, eq=False)
class PoseEvaluation:
    """The outcome over all images."""

    scores: PoseScores
    """Average recalls, in all and per part."""
    summary: PoseSummary
    """Over all targets."""
    by_visibility: dict[str, PoseSummary]
    images: int
    detections: int
    estimation_s: float
    """Wall-clock time of all estimates."""

    @staticmethod
    def of(images: Sequence[ImageErrors]) -> PoseEvaluation:
        """Return the scores over these images."""
        instances = [instance for image in images for instance in image.instances]
        fractions = np.array([i.visible_fraction for i in instances])
        errors, depths_m = [i.error for i in instances], [i.depth_m for i in instances]
        return PoseEvaluation(
            pose_scores([target for image in images for target in image.targets]),
            summarize_instances(instances),
            summarize_by_visibility(errors, fractions, VISIBILITY_BANDS, depths_m),
            len(images),
            sum(image.detections for image in images),
            sum(image.estimation_s for image in images),
        )

    @property
    def ms_per_detection(self) -> float:
        """Return the mean time of an estimate; NaN without detections."""
        return 1e3 * self.estimation_s / self.detections if self.detections else float("nan")


class PoseEvaluator:
    """Takes images with their estimates one by one and keeps only their errors. A context manager.

    With `vsd`, every image needs depth, and parts are rendered through OpenGL; without, AR stays None, since BOP's AR
    is the mean of three terms.
    """

    def __init__(self, model_of: Callable[[str], PoseModel], *, vsd: bool = True, delta_m: float = VSD_DELTA_M) -> None:
        self._model_of, self._vsd, self._delta_m = model_of, vsd, delta_m
        self._models: dict[str, PoseModel] = {}
        self._renderer = PosedDepthRenderer()
        self._images: list[ImageErrors] = []

    def add(self, image: PoseImage, estimates: Sequence[PoseEstimate], elapsed_s: float) -> ImageErrors:
        """Score one image's estimates, which took `elapsed_s` together, and return what is kept of them.

        Raises:
            ConfigError: VSD is wanted and the image has no depth.
        """
        if self._vsd and image.frame.depth_m is None:
            raise ConfigError(
                f"VSD needs depth, and scene {image.scene_id}, image {image.im_id} has none; evaluate without VSD "
                "(--no-vsd)"
            )
        scored = [self._score(image, target) for target in self._targets(image, estimates)]
        instances = tuple(instance for _, answers in scored for instance in answers)
        errors = ImageErrors(tuple(target for target, _ in scored), instances, len(image.detections), elapsed_s)
        self._images.append(errors)
        return errors

    def instance_errors(self, image: PoseImage, estimates: Sequence[PoseEstimate]) -> tuple[InstanceError, ...]:
        """Return only how each instance was answered, which costs little, and keep nothing."""
        return tuple(
            error for target in self._targets(image, estimates) for error in _instance_errors(target, _answers(target))
        )

    def result(self) -> PoseEvaluation:
        """Return the scores of all images so far."""
        return PoseEvaluation.of(self._images)

    def close(self) -> None:
        """Free the OpenGL contexts; may be called again."""
        self._renderer.close()

    def __enter__(self) -> PoseEvaluator:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _targets(self, image: PoseImage, estimates: Sequence[PoseEstimate]) -> list[_Target]:
        """Return what counts: of each part the surest estimates and the most visible truths."""
        targets = []
        for part, inst_count in sorted(image.inst_counts.items()):
            if part not in self._models:
                self._models[part] = self._model_of(part)
            own = [e for e in estimates if e.part == part]
            truths = [truth for truth in image.truths if truth.part == part]
            scores = np.array([estimate.score for estimate in own])
            fractions = np.array([truth.visible_fraction for truth in truths])
            targets.append(
                _Target(
                    self._models[part],
                    inst_count,
                    [own[k] for k in top_estimates(scores, inst_count)],
                    [truths[k] for k in valid_truths(fractions, inst_count)],
                )
            )
        return targets

    def _score(self, image: PoseImage, target: _Target) -> tuple[TargetErrors, list[InstanceError]]:
        camera, depth = image.frame.camera, None
        if self._vsd and image.frame.depth_m is not None:
            rendered = [self._renderer.render(target.model, Ts, camera) for Ts in (target.Ts_estimate, target.Ts_truth)]
            depth = DepthImages(image.frame.depth_m, rendered[0], rendered[1], self._delta_m)
        errors = target_errors(
            target.model.evaluation,
            camera,
            target.Ts_estimate,
            np.array([estimate.score for estimate in target.estimates]),
            target.Ts_truth,
            np.array([truth.visible_fraction for truth in target.truths]),
            target.inst_count,
            depth,
        )
        return errors, _instance_errors(target, _answers(target))


def summarize_instances(instances: Sequence[InstanceError]) -> PoseSummary:
    """Return the summary of these instances."""
    return summarize([i.error for i in instances], [i.depth_m for i in instances])


@dataclass(frozen=True, eq=False)
class _Target:
    """One part in one image, with the estimates and truths that count."""

    model: PoseModel
    inst_count: int
    estimates: list[PoseEstimate]
    truths: list[PoseTruth]

    @cached_property
    def Ts_estimate(self) -> Float[np.ndarray, "e 4 4"]:
        return np.array([e.T_camera_part for e in self.estimates]).reshape(-1, 4, 4)

    @cached_property
    def Ts_truth(self) -> Float[np.ndarray, "g 4 4"]:
        return np.array([t.T_camera_part for t in self.truths]).reshape(-1, 4, 4)


def _answers(target: _Target) -> list[int | None]:
    """Return which estimate answers each truth.

    Where detections know the instance that they came from, that decides; else the surest estimates choose the nearest
    truth by MSSD, one each, however far off.
    """
    answers: list[int | None] = [None] * len(target.truths)
    index = {truth.instance: g for g, truth in enumerate(target.truths)}
    known = [None if e.detection is None else e.detection.instance for e in target.estimates]
    if known and all(instance is not None for instance in known):
        for e, instance in enumerate(known):
            if instance in index and answers[index[instance]] is None:
                answers[index[instance]] = e
    elif known and target.truths:
        errors = mssd(target.Ts_estimate[:, None], target.Ts_truth[None], target.model.evaluation)
        for e, match in enumerate(greedy_matches(errors, np.array([np.inf]))[0]):
            if match >= 0:
                answers[match] = e
    return answers


def _instance_errors(target: _Target, answers: Sequence[int | None]) -> list[InstanceError]:
    pairs = [(e, g) for g, e in enumerate(answers) if e is not None]
    estimates, truths = target.Ts_estimate[[e for e, _ in pairs]], target.Ts_truth[[g for _, g in pairs]]
    errors = dict(
        zip((g for _, g in pairs), batch_pose_errors(estimates, truths, target.model.evaluation), strict=True)
    )
    return [
        InstanceError(errors.get(g), truth.visible_fraction, float(truth.T_camera_part[2, 3]))
        for g, truth in enumerate(target.truths)
    ]
