"""Scoring pose estimates image by image: BOP's average recalls, medians, and both by visibility."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from simpick.closing import Closing
from simpick.core_time import CoreTime, total
from simpick.errors import ConfigError
from simpick.metrics.matching import greedy_matches, top_estimates, valid_truths
from simpick.metrics.pose_errors import batch_pose_errors, mssd, pose_error
from simpick.metrics.scores import DepthImages, PoseScores, TargetErrors, pose_scores, target_errors
from simpick.metrics.summaries import PoseSummary, summarize, summarize_by_visibility
from simpick.metrics.visible_surface import VSD_DELTA_M
from simpick.pose_eval.pose_images import PoseImage, PoseModel, PoseTruth
from simpick.pose_eval.pose_sources import Answer, PoseSource, answers
from simpick.records import PoseError, PoseEstimate
from simpick.rendering.posed_depth import PosedDepthRenderer
from simpick.terminal import Console, track


@dataclass(frozen=True, eq=False)
class InstanceError:
    """The pose error of one instance that was to be found."""

    error: PoseError | None
    """None without an estimate."""
    visible_fraction: float
    depth_m: float
    """True depth of the part's origin along the optical axis."""


@dataclass(frozen=True, eq=False)
class ImageErrors:
    """The errors of all estimates of one image."""

    targets: tuple[TargetErrors, ...]
    """One per part."""
    instances: tuple[InstanceError, ...]
    """One per instance that was to be found."""
    detections: int
    estimation_s: float
    """Wall-clock time of the image's estimates."""
    core_time: CoreTime
    """Meanwhile."""


@dataclass(frozen=True, eq=False)
class PoseEvaluation:
    """The scores over all images."""

    scores: PoseScores
    """Average recalls, overall and per part."""
    summary: PoseSummary
    """Over all targets."""
    by_visibility: dict[str, PoseSummary]
    images: int
    detections: int
    estimation_s: float
    """Wall-clock time of all estimates."""
    core_time: CoreTime
    """Meanwhile; says whether other programs disturbed the times."""

    @staticmethod
    def of(images: Sequence[ImageErrors]) -> PoseEvaluation:
        """Return the scores over these images."""
        instances = [instance for image in images for instance in image.instances]
        fractions = np.array([i.visible_fraction for i in instances])
        errors, depths_m = [i.error for i in instances], [i.depth_m for i in instances]
        return PoseEvaluation(
            pose_scores([target for image in images for target in image.targets]),
            summarize_instances(instances),
            summarize_by_visibility(errors, fractions, depths_m),
            len(images),
            sum(image.detections for image in images),
            sum(image.estimation_s for image in images),
            total(image.core_time for image in images),
        )

    @property
    def ms_per_detection(self) -> float:
        """Return the mean time per estimate in milliseconds; NaN without detections."""
        return 1e3 * self.estimation_s / self.detections if self.detections else float("nan")


class PoseEvaluator(Closing):
    """Computes the errors of estimates. A context manager.

    With `vsd`, every image needs depth, and parts are rendered through OpenGL; without, AR is None, since BOP's AR is
    the mean of three terms.
    """

    def __init__(self, model_of: Callable[[str], PoseModel], *, vsd: bool = True, delta_m: float = VSD_DELTA_M) -> None:
        self._model_of, self._vsd, self._delta_m = model_of, vsd, delta_m
        self._models: dict[str, PoseModel] = {}
        self._renderer = PosedDepthRenderer()

    def score(self, answer: Answer) -> ImageErrors:
        """Return the errors of one image's estimates.

        Raises:
            ConfigError: VSD is to be computed and the image has no depth.
        """
        image = answer.image
        if self._vsd and image.frame.depth_m is None:
            raise ConfigError(
                f"VSD needs depth, and scene {image.scene_id}, image {image.im_id} has none; evaluate without VSD "
                "(--no-vsd)"
            )
        targets = self._targets(image, answer.estimates)
        return ImageErrors(
            tuple(self._target_errors(image, target) for target in targets),
            tuple(error for target in targets for error in _instance_errors(target)),
            len(image.detections),
            answer.estimation_s,
            answer.core_time,
        )

    def instance_errors(self, image: PoseImage, estimates: Sequence[PoseEstimate]) -> tuple[InstanceError, ...]:
        """Return only the pose errors by instance, which is cheap: nothing is rendered."""
        return tuple(error for target in self._targets(image, estimates) for error in _instance_errors(target))

    def close(self) -> None:
        """Free the OpenGL contexts; may be called again."""
        self._renderer.close()

    def _targets(self, image: PoseImage, estimates: Sequence[PoseEstimate]) -> list[_Target]:
        """Return what counts: per part, the estimates with the highest scores and the most visible truths."""
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

    def _target_errors(self, image: PoseImage, target: _Target) -> TargetErrors:
        camera, model, depth = image.frame.camera, target.model, None
        if self._vsd and image.frame.depth_m is not None:
            rendered = [
                self._renderer.render(model.rendered, Ts @ model.T_part_rendered, camera)
                for Ts in (target.Ts_estimate, target.Ts_truth)
            ]
            depth = DepthImages(image.frame.depth_m, rendered[0], rendered[1], self._delta_m)
        return target_errors(
            model.evaluation,
            camera,
            target.Ts_estimate,
            np.array([estimate.score for estimate in target.estimates]),
            target.Ts_truth,
            np.array([truth.visible_fraction for truth in target.truths]),
            target.inst_count,
            depth,
        )


def score_images(
    images: Iterable[PoseImage],
    source: PoseSource,
    evaluator: PoseEvaluator,
    *,
    total: int | None = None,
    on_answer: Callable[[Answer], None] | None = None,
    console: Console | None = None,
) -> PoseEvaluation:
    """Estimate and score every image with a progress bar; `on_answer` receives each answer."""
    errors = []
    for answer in track(answers(images, source), "images", total=total, console=console):
        errors.append(evaluator.score(answer))
        if on_answer is not None:
            on_answer(answer)
    return PoseEvaluation.of(errors)


def estimate_errors(
    answer: Answer, model_of: Callable[[str], PoseModel]
) -> list[tuple[PoseEstimate, PoseTruth, PoseError]]:
    """Return each estimate with the truth of its detection's instance and its error; all detections must have one."""
    truths = {truth.instance: truth for truth in answer.image.truths}
    found = []
    for estimate in answer.estimates:
        assert estimate.detection is not None and estimate.detection.instance is not None
        truth = truths[estimate.detection.instance]
        error = pose_error(estimate.T_camera_part, truth.T_camera_part, model_of(truth.part).evaluation)
        found.append((estimate, truth, error))
    return found


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


def _estimate_of_each(target: _Target) -> dict[int, int]:
    """Return the index of the estimate of each truth that has one.

    If all detections name the instance that they come from, it decides; else estimates choose the nearest truth by
    MSSD in the order of their scores, each truth once, at any distance.
    """
    known = [None if e.detection is None else e.detection.instance for e in target.estimates]
    if known and target.truths and None in known:
        errors = mssd(target.Ts_estimate[:, None], target.Ts_truth[None], target.model.evaluation)
        matches = greedy_matches(errors, np.array([np.inf]))[0]
        return {int(g): e for e, g in enumerate(matches) if g >= 0}
    index = {truth.instance: g for g, truth in enumerate(target.truths)}
    first: dict[int, int] = {}
    for e, instance in enumerate(known):
        if instance in index:
            first.setdefault(index[instance], e)
    return first


def _instance_errors(target: _Target) -> list[InstanceError]:
    estimate_of = _estimate_of_each(target)
    Ts_estimate = target.Ts_estimate[list(estimate_of.values())]
    Ts_truth = target.Ts_truth[list(estimate_of)]
    errors = dict(zip(estimate_of, batch_pose_errors(Ts_estimate, Ts_truth, target.model.evaluation), strict=True))
    return [
        InstanceError(errors.get(g), truth.visible_fraction, float(truth.T_camera_part[2, 3]))
        for g, truth in enumerate(target.truths)
    ]
