"""One rendered part as a frame with its detection: the refiner's simplest image."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from simpick.assets.library import get_part
from simpick.geometry import Pinhole, box_of_mask, so3_exp, transform
from simpick.records import CameraFrame, Detection, PoseHypothesis
from simpick.rendering import PartRenderer

CAMERA = Pinhole(320, 240, 700.0, 700.0, 160.0, 120.0)
T_TRUE = transform(so3_exp(np.array([0.5, -0.4, 0.8])), np.array([0.02, -0.01, 0.6]))


def frame_of(part: str, T_camera_part: Float[np.ndarray, "4 4"] = T_TRUE) -> tuple[CameraFrame, Detection]:
    """Return the part before a grey background, and its perfect detection."""
    with PartRenderer(get_part(part), CAMERA.height, CAMERA.width) as renderer:
        views = renderer.render(T_camera_part[None], CAMERA)
    assert views.rgb is not None
    mask = views.masks[0]
    rgb = np.where(mask[..., None], views.rgb[0], 90).astype(np.uint8)
    return CameraFrame(rgb, CAMERA, np.eye(4)), Detection(part, box_of_mask(mask), mask, 1.0)


def hidden_by(detection: Detection, occluder: Bool[np.ndarray, "height width"]) -> tuple[Detection, Detection]:
    """Return the detection without the occluder's pixels, and the occluder as a detection of its own."""
    assert detection.mask is not None
    rest = detection.mask & ~occluder
    return (
        Detection(detection.part, box_of_mask(rest), rest, 1.0),
        Detection(detection.part, box_of_mask(occluder), occluder, 1.0),
    )


def start(rotation_deg: float, depth_share: float, axis: tuple[float, float, float] = (0.6, -0.5, 0.6)):
    """Return the true pose, disturbed, as a hypothesis."""
    direction = np.array(axis) / np.linalg.norm(axis)
    T = T_TRUE.copy()
    T[:3, :3] = so3_exp(np.radians(rotation_deg) * direction) @ T[:3, :3]
    T[:3, 3] *= 1 + depth_share
    return PoseHypothesis(T, 1.0)
