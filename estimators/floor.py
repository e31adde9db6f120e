"""The bin's floor as a bound of depth: no part reaches below it, and most parts rest on it.

The image shows a part's depth by its size alone: half a pixel of outline all around is about a centimetre. Where the
camera's pose is known, the floor is the plane z = 0 of the world (see `simpick.geometry`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from simpick.assets.part import Part
from simpick.geometry import invert
from simpick.grasping.resting import raised_onto_floor
from simpick.records import CameraFrame, PoseEstimate

_FARTHEST_M = 0.3
"""If most parts are farther from the plane z = 0 than this, it is not the floor that they lie on."""
_SCALE_M = 0.004
"""Height at which the pull of the floor is strongest."""
_BELOW_WEIGHT, _REST_WEIGHT = 20.0, 5.0
"""Costs at `_SCALE_M`, twice the latter's; those of images are sums over pixels, some tens."""
_SOFTNESS_M = 0.001
"""Vertices this much higher than the lowest one weigh 1/e of it, so that faces come to rest and not their corners."""


@dataclass(frozen=True, eq=False)
class Floor:
    """The floor, with the camera above it."""

    T_world_camera: Float[np.ndarray, "4 4"]

    @staticmethod
    def below(
        frame: CameraFrame, parts: Sequence[Part], Ts_camera_part: Sequence[Float[np.ndarray, "4 4"]]
    ) -> Floor | None:
        """Return the floor below parts in these poses; None without parts, or if the frame does not say where it is.

        That is so if the camera's pose is unknown (the identity), below z = 0, or far from there with all parts.
        """
        T = frame.T_world_camera
        if not len(Ts_camera_part) or np.array_equal(T, np.eye(4)) or T[2, 3] <= 0:
            return None
        heights_m = [float((T @ T_camera_part)[2, 3]) for T_camera_part in Ts_camera_part]
        return None if np.median(np.abs(heights_m)) > _FARTHEST_M else Floor(T)

    def raised(self, part: Part, Ts_camera_part: Float[np.ndarray, "n 4 4"]) -> Float[np.ndarray, "n 4 4"]:
        """Return the poses, those below the floor moved towards the camera until they rest on it."""
        eye_m = self.T_world_camera[:3, 3]
        Ts = [raised_onto_floor(part, self.T_world_camera @ T, eye_m) for T in Ts_camera_part]
        return invert(self.T_world_camera) @ np.stack(Ts)

    @staticmethod
    def under(frame: CameraFrame, estimates: Sequence[PoseEstimate], parts: Mapping[str, Part]) -> list[PoseEstimate]:
        """Return the estimates with all hypotheses raised onto the floor, if the frame says where it is."""
        floor = Floor.below(frame, [parts[e.part] for e in estimates], [e.T_camera_part for e in estimates])
        return list(estimates) if floor is None else [floor._raised_estimate(e, parts[e.part]) for e in estimates]

    def _raised_estimate(self, estimate: PoseEstimate, part: Part) -> PoseEstimate:
        poses = [estimate.T_camera_part, *(h.T_camera_part for h in estimate.hypotheses)]
        best, *others = self.raised(part, np.stack(poses))
        hypotheses = tuple(replace(h, T_camera_part=T) for h, T in zip(estimate.hypotheses, others, strict=True))
        return replace(estimate, T_camera_part=best, hypotheses=hypotheses)

    def equations(
        self, part: Part, Ts_crop_part: Float[np.ndarray, "n 4 4"], Rs_crop_camera: Float[np.ndarray, "n 3 3"]
    ) -> tuple[Float[Tensor, "n"], Float[Tensor, "n 6 6"], Float[Tensor, "n 6"]]:
        """Return cost, Hessian and gradient of the lowest points' heights, for the parameters of `alignment`.

        The cost is quadratic below the floor; above, parts that are nearly on it are drawn to it.
        """
        up = Rs_crop_camera @ self.T_world_camera[2, :3]
        hull_m = np.asarray(part.mesh.convex_hull.vertices)
        origin = Ts_crop_part[:, :3, 3]
        arms = np.einsum("nij,vj->nvi", Ts_crop_part[:, :3, :3], hull_m)
        origin_height = (origin * up).sum(axis=1) + self.T_world_camera[2, 3]
        heights = np.einsum("nvi,ni->nv", arms, up) + origin_height[:, None]
        weights = np.exp(-(heights - heights.min(axis=1, keepdims=True)) / _SOFTNESS_M)
        weights /= weights.sum(axis=1, keepdims=True)
        arm = np.einsum("nv,nvi->ni", weights, arms)
        # A point at O + a moves by w x a, by Z0 (dx0, dy0, 0), and by O dzeta.
        along_sight = (origin * up).sum(axis=1, keepdims=True)
        J = np.concatenate([np.cross(arm, up), origin[:, 2:] * up[:, :2], along_sight], axis=1) / _SCALE_M
        r = (weights * heights).sum(axis=1) / _SCALE_M
        square = r * r
        cost = np.where(r < 0, _BELOW_WEIGHT * square, _REST_WEIGHT * square / (1 + square))
        weight = np.where(r < 0, _BELOW_WEIGHT, _REST_WEIGHT / (1 + square) ** 2)
        H, g = weight[:, None, None] * J[:, :, None] * J[:, None, :], (weight * r)[:, None] * J
        return torch.from_numpy(cost).float(), torch.from_numpy(H).float(), torch.from_numpy(g).float()
