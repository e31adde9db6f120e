"""The oracle: true poses, optionally with calibrated noise. The upper bound that every mode is compared with."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.config import Config, NonNegativeFloat
from simpick.errors import ConfigError
from simpick.geometry import invert, so3_exp
from simpick.records import CameraFrame, Detection, InstanceTruth, PoseEstimate, PoseHypothesis

MEDIAN_OF_CHI3 = 1.5381722544550522
"""Median of the norm of a standard normal vector in three dimensions (Maxwell distribution)."""


@dataclass(frozen=True)
class PoseNoise(Config):
    """Gaussian pose noise, specified by the *median* error that it causes."""

    rotation_deg: NonNegativeFloat = 0.0
    """Median rotation error in degrees, about an axis in a uniformly random direction."""
    translation_mm: NonNegativeFloat = 0.0
    """Median translation error in millimetres, in a uniformly random direction."""

    @property
    def is_zero(self) -> bool:
        """Return whether poses stay unchanged."""
        return self.rotation_deg == 0 and self.translation_mm == 0

    def apply(self, T_a_part: Float[np.ndarray, "4 4"], rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
        """Return the pose rotated about the part's origin and shifted; always draws six numbers from `rng`."""
        rotation, shift = rng.normal(size=(2, 3)) / MEDIAN_OF_CHI3
        noisy = T_a_part.copy()
        noisy[:3, :3] = so3_exp(np.radians(self.rotation_deg) * rotation) @ T_a_part[:3, :3]
        noisy[:3, 3] += 1e-3 * self.translation_mm * shift
        return noisy


class OracleEstimator:
    """Returns the true pose of every detected instance, with `noise` added. Implements `PoseEstimator`."""

    def __init__(
        self,
        truth: Callable[[], Sequence[InstanceTruth]],
        noise: PoseNoise | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        """Take a function that returns the present truth, such as ``env.unwrapped.truth``.

        Raises:
            ConfigError: there is noise, but no generator to draw it from.
        """
        self._truth = truth
        self._noise = noise or PoseNoise()
        if rng is None and not self._noise.is_zero:
            raise ConfigError("an oracle with noise needs a random generator: pass rng=numpy.random.default_rng(seed)")
        self._rng = rng

    def onboard(self, part: Part) -> None:
        """Do nothing: the truth needs no templates."""

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return the true pose of each detection with an instance id; others get no estimate."""
        start = time.perf_counter()
        truth = {t.instance: t for t in self._truth()}
        T_camera_world = invert(frame.T_world_camera)
        poses = []
        for detection in detections:
            if detection.instance is None or detection.instance not in truth:
                continue
            T_camera_part = T_camera_world @ truth[detection.instance].T_world_part
            if self._rng is not None:
                T_camera_part = self._noise.apply(T_camera_part, self._rng)
            poses.append((detection, T_camera_part))
        elapsed_s = (time.perf_counter() - start) / max(len(poses), 1)
        return [PoseEstimate(d.part, T, d.score, "oracle", elapsed_s, detection=d) for d, T in poses]


class OracleRefiner(OracleEstimator):
    """Returns true poses with `noise` added: the upper bound of refiners. Implements `PoseRefiner`."""

    def refine(
        self, frame: CameraFrame, detections: Sequence[Detection], hypotheses: Sequence[Sequence[PoseHypothesis]]
    ) -> list[tuple[PoseHypothesis, ...]]:
        """Return the true pose of each detection with an instance id, none for others."""
        found = {id(e.detection): PoseHypothesis(e.T_camera_part, 1.0) for e in self.estimate(frame, detections)}
        return [(found[id(d)],) if id(d) in found else () for d in detections]
