"""Checks of an estimate that need no truth: do the image's edges and the mask agree with it, and is there a rival?"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from simpick.assets.part import Part
from simpick.geometry import box_of_mask, invert
from simpick.records import CameraFrame, PoseEstimate, PoseHypothesis
from simpick.rendering.luminance import LUMINANCE

_BLUR_PX = 1.0
_MARGIN_PX = 10
_REACH_PX = 2
"""Distance from the contour in which an edge of the image is looked for, along the contour's normal."""
_EDGE_LEVELS = 5.0
"""Change of brightness per pixel, in grey levels, that counts as an edge."""
_LEAST_EDGES, _LEAST_OVERLAP = 0.5, 0.7
"""Agreement below which a reason is stated."""
_RIVAL_SHARE = 0.85
"""A hypothesis with at least this share of the best one's score fits nearly as well."""
_RIVAL_DEG, _RIVAL_DIAMETERS = 15.0, 0.1
"""Rivals differ by more than one of these from the estimate, over the part's symmetries."""


@dataclass(frozen=True, eq=False)
class RivalPose:
    """Another pose that fits nearly as well."""

    T_camera_cad: Float[np.ndarray, "4 4"]
    """In metres."""
    share: float
    """Its score as a share of the best one's."""
    rotation_deg: float
    """Angle to the estimate over the part's symmetries."""
    distance_m: float
    """Between the part's centres."""


@dataclass(frozen=True, eq=False)
class PoseChecks:
    """What speaks for and against one estimate."""

    edge_agreement: float
    """Share of the visible contour that has an edge of the image within 2 px; NaN where nothing of it is visible."""
    mask_agreement: float
    """Intersection over union of the silhouette and the detection's mask; NaN without a mask."""
    rivals: tuple[RivalPose, ...]
    """Best first."""
    reasons: tuple[str, ...]
    """Sentences about what speaks against the estimate; empty if nothing does."""


def check_pose(
    estimate: PoseEstimate,
    part: Part,
    frame: CameraFrame,
    silhouette: Bool[np.ndarray, "height width"],
) -> PoseChecks:
    """Return the checks of an estimate whose part covers the pixels of `silhouette`."""
    edges = edge_agreement(frame.rgb, silhouette)
    mask = None if estimate.detection is None else estimate.detection.mask
    overlap = float("nan")
    if mask is not None and (mask | silhouette).any():
        overlap = float((mask & silhouette).sum() / (mask | silhouette).sum())
    rivals = _rivals(estimate, part)
    reasons = []
    if not silhouette.any():
        reasons.append("the estimated pose lies outside the image")
    elif edges < _LEAST_EDGES:
        reasons.append(f"only {100 * edges:.0f} % of its contour lies on edges of the image")
    if overlap < _LEAST_OVERLAP:
        reasons.append(f"its silhouette and the detection's mask overlap by {100 * overlap:.0f} % only")
    if rivals:
        first = rivals[0]
        moved = f"turned by {first.rotation_deg:.0f} degrees" if first.rotation_deg > _RIVAL_DEG else "moved"
        moved += f", {1e3 * first.distance_m:.0f} mm away" if first.distance_m > 5e-4 else ""
        reasons.append(f"another pose ({moved}) fits {100 * first.share:.0f} % as well")
    return PoseChecks(edges, overlap, rivals, tuple(reasons))


def edge_agreement(rgb: UInt8[np.ndarray, "height width 3"], silhouette: Bool[np.ndarray, "height width"]) -> float:
    """Return the share of the silhouette's contour that lies on edges of the image; NaN for an empty one.

    At each pixel of the contour that is not at the image's border, the image's gradient along the contour's normal is
    searched within 2 px.
    """
    image_height, image_width = silhouette.shape
    x0, y0, x1, y1 = box_of_mask(silhouette).astype(int)
    left, top = max(x0 - _MARGIN_PX, 0), max(y0 - _MARGIN_PX, 0)
    window = slice(top, min(y1 + _MARGIN_PX, image_height)), slice(left, min(x1 + _MARGIN_PX, image_width))
    rgb, silhouette = rgb[window], silhouette[window]
    outlines, _ = cv2.findContours(silhouette.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    points = np.concatenate([np.zeros((0, 1, 2), np.int32), *outlines])[:, 0].astype(np.float32)
    x, y = points[:, 0] + left, points[:, 1] + top
    points = points[(x > 0) & (y > 0) & (x < image_width - 1) & (y < image_height - 1)]
    if len(points) == 0:
        return float("nan")
    gray = cv2.GaussianBlur((rgb @ np.array(LUMINANCE)).astype(np.float32), (0, 0), _BLUR_PX)
    normals = _unit(_gradient(cv2.GaussianBlur(silhouette.astype(np.float32), (0, 0), 2.0), points))
    strongest = np.zeros(len(points))
    for step in range(-_REACH_PX, _REACH_PX + 1):
        along = np.abs((_gradient(gray, points + step * normals) * normals).sum(axis=1))
        strongest = np.maximum(strongest, along)
    return float((strongest >= _EDGE_LEVELS).mean())


def _gradient(image: Float32[np.ndarray, "height width"], points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Return the image's gradient per pixel at points (x, y) in OpenCV's coordinates."""
    x, y = (np.ascontiguousarray(points[:, k], np.float32)[:, None] for k in (0, 1))

    def at(dx: float, dy: float) -> np.ndarray:
        return cv2.remap(
            image, x + np.float32(dx), y + np.float32(dy), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )[:, 0]

    return np.stack([(at(1, 0) - at(-1, 0)) / 2, (at(0, 1) - at(0, -1)) / 2], axis=1).astype(float)


def _unit(vectors: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)


def _rivals(estimate: PoseEstimate, part: Part) -> tuple[RivalPose, ...]:
    """Return the distinct hypotheses that fit nearly as well as the best one."""
    if not estimate.hypotheses:
        return ()
    best = max(hypothesis.score for hypothesis in estimate.hypotheses)
    ranked = sorted(estimate.hypotheses, key=lambda hypothesis: -hypothesis.score)
    found = [_rival(hypothesis, estimate, part, best) for hypothesis in ranked]
    return tuple(
        rival
        for rival in found
        if rival.share >= _RIVAL_SHARE
        and (rival.rotation_deg > _RIVAL_DEG or rival.distance_m > _RIVAL_DIAMETERS * part.diameter_m)
    )


def _rival(hypothesis: PoseHypothesis, estimate: PoseEstimate, part: Part, best: float) -> RivalPose:
    T, ours = hypothesis.T_camera_part, estimate.T_camera_part
    equivalent = part.symmetries.closest_equivalent(T, ours)
    return RivalPose(
        T @ invert(part.T_cad_part),
        hypothesis.score / best if best > 0 else 0.0,
        float(np.degrees(part.symmetries.rotation_distance(T[:3, :3], ours[:3, :3]))),
        float(np.linalg.norm(equivalent[:3, 3] - ours[:3, 3])),
    )
