"""BOP's average recalls: AR_VSD, AR_MSSD, AR_MSPD and their mean, pooled over all targets, overall and per part.

One `TargetErrors` represents all instances of one part in one image, like a row of ``test_targets_bop19.json``.
Constants and rules are those of the BOP toolkit's ``eval_bop19_pose``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.errors import ConfigError
from simpick.geometry import Pinhole
from simpick.metrics.matching import greedy_matches, top_estimates, valid_truths
from simpick.metrics.models import EvaluationModel
from simpick.metrics.pose_errors import bounding_spheres_overlap, mspd, mssd, sphere_projections_overlap
from simpick.metrics.visible_surface import VSD_DELTA_M, VSD_TAUS, vsd

VSD_THRESHOLDS = np.arange(0.05, 0.51, 0.05)
"""An estimate is correct if its VSD is below; there is one recall per threshold and tolerance in `VSD_TAUS`."""
MSSD_THRESHOLDS = np.arange(0.05, 0.51, 0.05)
"""An estimate is correct if its MSSD, as a fraction of the diameter, is below."""
MSPD_THRESHOLDS_PX = np.arange(5.0, 51.0, 5.0)
"""An estimate is correct if its MSPD in an image 640 px wide is below."""


@dataclass(frozen=True, eq=False)
class DepthImages:
    """The depth images that VSD needs, all in the frame's own camera."""

    scene_m: Float[np.ndarray, "height width"]
    """The scene as measured or rendered; 0 means no reading."""
    estimates_m: Float[np.ndarray, "e height width"]
    """The part alone, rendered at each estimate; 0 outside it."""
    truths_m: Float[np.ndarray, "g height width"]
    """The part alone, rendered at each true pose; 0 outside it."""
    delta_m: float = VSD_DELTA_M
    """Tolerance of the visibility test."""


@dataclass(frozen=True, eq=False)
class TargetErrors:
    """Errors between the estimates (highest score first) and the truths that count, of one part in one image."""

    name: str
    """The part's name."""
    mssd: Float[np.ndarray, "e g"]
    """As a fraction of the diameter; infinite where the bounding spheres do not overlap."""
    mspd_px: Float[np.ndarray, "e g"]
    """Scaled to an image width of 640."""
    vsd: Float[np.ndarray, "e g t"] | None
    """For each of `VSD_TAUS`; None if no depth was rendered."""

    @property
    def targets(self) -> int:
        """Return the number of instances to be found."""
        return self.mssd.shape[1]


@dataclass(frozen=True, eq=False)
class AverageRecalls:
    """Recalls over a set of targets."""

    targets: int
    """Number of instances to be found."""
    recalls_mssd: Float[np.ndarray, "k"]
    """For each of `MSSD_THRESHOLDS`."""
    recalls_mspd: Float[np.ndarray, "k"]
    """For each of `MSPD_THRESHOLDS_PX`."""
    recalls_vsd: Float[np.ndarray, "t k"] | None
    """For each of `VSD_TAUS` and `VSD_THRESHOLDS`; None without rendered depth."""

    @property
    def ar_mssd(self) -> float:
        """Return the mean of the MSSD recalls."""
        return float(self.recalls_mssd.mean())

    @property
    def ar_mspd(self) -> float:
        """Return the mean of the MSPD recalls."""
        return float(self.recalls_mspd.mean())

    @property
    def ar_vsd(self) -> float | None:
        """Return the mean of the VSD recalls, or None without rendered depth."""
        return None if self.recalls_vsd is None else float(self.recalls_vsd.mean())

    @property
    def ar(self) -> float | None:
        """Return BOP's AR, the mean of the three terms; None without the VSD term."""
        return None if self.ar_vsd is None else (self.ar_vsd + self.ar_mssd + self.ar_mspd) / 3

    @property
    def ar_computed(self) -> float:
        """Return the mean of the terms that were computed: BOP's AR, or that of MSSD and MSPD without VSD."""
        return (self.ar_mssd + self.ar_mspd) / 2 if self.ar is None else self.ar


@dataclass(frozen=True, eq=False)
class PoseScores:
    """Average recalls, overall and per part."""

    overall: AverageRecalls
    """Pooled over all targets: frequent parts have more weight."""
    by_part: dict[str, AverageRecalls]
    """By the part's name, in alphabetical order."""


def target_errors(
    model: EvaluationModel,
    camera: Pinhole,
    Ts_camera_estimate: Float[np.ndarray, "e 4 4"],
    scores: Float[np.ndarray, "scores"],
    Ts_camera_truth: Float[np.ndarray, "g 4 4"],
    visible_fractions: Float[np.ndarray, "fractions"],
    inst_count: int,
    depth: DepthImages | None = None,
) -> TargetErrors:
    """Return the errors between all estimates and all true poses of one part in one image.

    Only the `inst_count` estimates with the highest scores and the `inst_count` most visible truths count; a caller
    need not render the others, which `top_estimates` and `valid_truths` leave out.

    Raises:
        ConfigError: a score is not finite, or lists differ in length.
    """
    for name, values, poses in [
        ("scores", scores, Ts_camera_estimate),
        ("visible fractions", visible_fractions, Ts_camera_truth),
        ("depth images of estimates", depth.estimates_m if depth else Ts_camera_estimate, Ts_camera_estimate),
        ("depth images of truths", depth.truths_m if depth else Ts_camera_truth, Ts_camera_truth),
    ]:
        if len(values) != len(poses):
            raise ConfigError(f"there must be as many {name} as poses, got {len(values)} for {len(poses)}")
    kept, valid = top_estimates(scores, inst_count), valid_truths(visible_fractions, inst_count)
    estimates, truths = Ts_camera_estimate[kept, None], Ts_camera_truth[None, valid]
    near = bounding_spheres_overlap(estimates, truths, model.diameter_m)
    surface = np.full((len(kept), len(valid)), np.inf)
    e, g = np.nonzero(near)
    surface[e, g] = mssd(estimates[e, 0], truths[0, g], model) / model.diameter_m
    projection = mspd(estimates, truths, model, camera) * (640.0 / camera.width)
    discrepancy = None
    if depth is not None:
        discrepancy = vsd(
            depth.estimates_m[kept],
            depth.truths_m[valid],
            depth.scene_m,
            camera,
            model.diameter_m,
            delta_m=depth.delta_m,
            candidates=sphere_projections_overlap(estimates, truths, model.diameter_m),
        )
    return TargetErrors(model.name, surface, projection, discrepancy)


def pose_scores(errors: Sequence[TargetErrors]) -> PoseScores:
    """Return the average recalls over these images, overall and per part.

    Raises:
        ConfigError: only some targets have VSD.
    """
    names = sorted({e.name for e in errors})
    return PoseScores(average_recalls(errors), {n: average_recalls([e for e in errors if e.name == n]) for n in names})


def average_recalls(errors: Sequence[TargetErrors]) -> AverageRecalls:
    """Return the recalls pooled over these targets; without any target, zeros, as in the BOP toolkit.

    Raises:
        ConfigError: only some targets have VSD.
    """
    with_vsd = sum(e.vsd is not None for e in errors)
    if 0 < with_vsd < len(errors):
        raise ConfigError(f"VSD must be computed for all targets or for none, got it for {with_vsd} of {len(errors)}")
    found_mssd, found_mspd = np.zeros(len(MSSD_THRESHOLDS)), np.zeros(len(MSPD_THRESHOLDS_PX))
    found_vsd = np.zeros((len(VSD_TAUS), len(VSD_THRESHOLDS)))
    for target in errors:
        found_mssd += _found(target.mssd, MSSD_THRESHOLDS)
        found_mspd += _found(target.mspd_px, MSPD_THRESHOLDS_PX)
        if target.vsd is not None:
            found_vsd += [_found(target.vsd[..., t], VSD_THRESHOLDS) for t in range(len(VSD_TAUS))]
    targets = sum(e.targets for e in errors)
    whole = max(targets, 1)
    return AverageRecalls(targets, found_mssd / whole, found_mspd / whole, found_vsd / whole if with_vsd else None)


def _found(errors: Float[np.ndarray, "e g"], thresholds: Float[np.ndarray, "k"]) -> Float[np.ndarray, "k"]:
    """Return the number of matched truths at each threshold."""
    return (greedy_matches(errors, thresholds) >= 0).sum(1).astype(float)
