"""Pose errors over a part's symmetries, as defined by the BOP toolkit; transforms in metres, batches broadcast.

Surface distances are in metres, projection distances in pixels. BOP has pixel centres at integers, simpick at integer
+ 0.5; the offset cancels in every difference here, so no conversion is needed.

Sources: Hodan et al., "BOP Challenge 2020 on 6D Object Localization" (MSSD, MSPD); Hinterstoisser et al., ACCV 2012
(ADD, ADD-S).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from simpick.geometry import Pinhole, invert, rotation_angle, transform_points
from simpick.metrics.models import EvaluationModel
from simpick.records import PoseError


def batch_pose_errors(
    Ts_camera_estimate: Float[np.ndarray, "n 4 4"], Ts_camera_truth: Float[np.ndarray, "n 4 4"], model: EvaluationModel
) -> list[PoseError]:
    """Return the errors of estimates of one part, each compared with its truth.

    Rotation and translation errors refer to the equivalent true pose with the least rotation to the estimate.
    `lateral_mm` is the offset across the line of sight to that pose's origin, `depth_mm` the difference in z.
    """
    truth = model.symmetries.closest_equivalent(Ts_camera_truth, Ts_camera_estimate)
    turn = np.swapaxes(truth[:, :3, :3], -1, -2) @ Ts_camera_estimate[:, :3, :3]
    offset = Ts_camera_estimate[:, :3, 3] - truth[:, :3, 3]
    sight = truth[:, :3, 3] / np.maximum(np.linalg.norm(truth[:, :3, 3], axis=-1, keepdims=True), 1e-12)
    lateral = offset - (offset * sight).sum(-1, keepdims=True) * sight
    columns = (
        np.degrees(rotation_angle(turn)),
        1e3 * np.linalg.norm(offset, axis=-1),
        1e3 * np.linalg.norm(lateral, axis=-1),
        1e3 * offset[:, 2],
        1e3 * mssd(Ts_camera_estimate, Ts_camera_truth, model),
    )
    return [PoseError(*(float(value) for value in row)) for row in zip(*columns, strict=True)]


def pose_error(
    T_camera_estimate: Float[np.ndarray, "4 4"], T_camera_truth: Float[np.ndarray, "4 4"], model: EvaluationModel
) -> PoseError:
    """Return the errors of one estimate; see `batch_pose_errors`."""
    return batch_pose_errors(T_camera_estimate[None], T_camera_truth[None], model)[0]


def add(
    Ts_a_estimate: Float[np.ndarray, "*#batch 4 4"],
    Ts_a_truth: Float[np.ndarray, "*#batch 4 4"],
    model: EvaluationModel,
) -> Float[np.ndarray, "*batch"]:
    """Return the mean distance between corresponding vertices in metres (ADD), without symmetries."""
    estimate, truth, batch = _pairs(Ts_a_estimate, Ts_a_truth)
    difference = [_affine(E - T, model.vertices_m) for E, T in zip(estimate, truth, strict=True)]
    return np.array([np.linalg.norm(d, axis=-1).mean() for d in difference]).reshape(batch)


def add_s(
    Ts_a_estimate: Float[np.ndarray, "*#batch 4 4"],
    Ts_a_truth: Float[np.ndarray, "*#batch 4 4"],
    model: EvaluationModel,
) -> Float[np.ndarray, "*batch"]:
    """Return the mean distance in metres from true vertices to the nearest estimated vertex (ADD-S, BOP's ``adi``)."""
    estimate, truth, batch = _pairs(Ts_a_estimate, Ts_a_truth)
    # Distances are equal in the estimate's part frame, where one search tree is enough for all pairs.
    points = [transform_points(T, model.vertices_m) for T in invert(estimate) @ truth]
    return np.array([model.tree.query(p)[0].mean() for p in points]).reshape(batch)


def mssd(
    Ts_a_estimate: Float[np.ndarray, "*#batch 4 4"],
    Ts_a_truth: Float[np.ndarray, "*#batch 4 4"],
    model: EvaluationModel,
) -> Float[np.ndarray, "*batch"]:
    """Return the maximum symmetry-aware surface distance in metres.

    ``min over S in symmetries, max over vertices x of |T_estimate x - T_truth S x|``.
    """
    estimate, truth, batch = _pairs(Ts_a_estimate, Ts_a_truth)
    errors = [_closest_symmetry_error(E, T, model, lambda points: points) for E, T in zip(estimate, truth, strict=True)]
    return np.array(errors, float).reshape(batch)


def mspd(
    Ts_camera_estimate: Float[np.ndarray, "*#batch 4 4"],
    Ts_camera_truth: Float[np.ndarray, "*#batch 4 4"],
    model: EvaluationModel,
    camera: Pinhole,
) -> Float[np.ndarray, "*batch"]:
    """Return the maximum symmetry-aware projection distance in pixels of this camera.

    ``min over S in symmetries, max over vertices x of |project(T_estimate x) - project(T_truth S x)|``. BOP scales it
    to an image width of 640, as does `target_errors`.
    """
    estimate, truth, batch = _pairs(Ts_camera_estimate, Ts_camera_truth)
    # A vertex of a bad estimate may lie in the camera's plane: its error is infinite, without a warning.
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = [_closest_symmetry_error(E, T, model, camera.project) for E, T in zip(estimate, truth, strict=True)]
    return np.array(errors, float).reshape(batch)


def bounding_spheres_overlap(
    Ts_a_estimate: Float[np.ndarray, "*#batch 4 4"], Ts_a_truth: Float[np.ndarray, "*#batch 4 4"], diameter_m: float
) -> Bool[np.ndarray, "*batch"]:
    """Return whether the part frames' origins are closer than a diameter; otherwise BOP sets MSSD to infinity."""
    return np.asarray(np.linalg.norm(Ts_a_estimate[..., :3, 3] - Ts_a_truth[..., :3, 3], axis=-1) < diameter_m)


def sphere_projections_overlap(
    Ts_camera_estimate: Float[np.ndarray, "*#batch 4 4"],
    Ts_camera_truth: Float[np.ndarray, "*#batch 4 4"],
    diameter_m: float,
) -> Bool[np.ndarray, "*batch"]:
    """Return whether the images of the bounding spheres overlap approximately; otherwise BOP sets VSD to 1."""
    a, b = Ts_camera_estimate[..., :3, 3], Ts_camera_truth[..., :3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.linalg.norm(a[..., :2] / a[..., 2:] - b[..., :2] / b[..., 2:], axis=-1)
        reach = diameter_m / 2 * (1 / a[..., 2] + 1 / b[..., 2])
    return np.asarray((apart < reach) & (a[..., 2] != 0) & (b[..., 2] != 0))


def _closest_symmetry_error(
    T_estimate: Float[np.ndarray, "4 4"],
    T_truth: Float[np.ndarray, "4 4"],
    model: EvaluationModel,
    view: Callable[[np.ndarray], np.ndarray],
) -> float:
    """Return min over symmetries S, max over vertices x of |view(T_estimate x) - view(T_truth S x)|, exactly.

    A round part has hundreds of symmetries and thousands of vertices, few of which matter. Any vertices give a lower
    bound of each symmetry's error. For the symmetry with the least bound, the worst of all vertices is found, which
    makes its bound exact and tightens the others. Once the least bound is exact, no other symmetry can be better.
    """
    vertices, equivalents = model.vertices_m, T_truth @ model.symmetry_transforms
    estimate = view(_affine(T_estimate, vertices))

    def distances(symmetry: slice, vertex: np.ndarray | slice) -> np.ndarray:
        offset = view(_affine(equivalents[symmetry], vertices[vertex])) - estimate[vertex]
        distance = np.linalg.norm(offset, axis=-1)
        return np.where(np.isnan(distance), np.inf, distance)

    bounds = distances(slice(None), model.spread_vertices).max(-1)
    exact = np.zeros(len(bounds), bool)
    while not exact[s := int(bounds.argmin())]:
        worst = distances(slice(s, s + 1), slice(None))[0].argmax(keepdims=True)
        bounds = np.maximum(bounds, distances(slice(None), worst)[:, 0])
        exact[s] = True
    return float(bounds[s])


def _pairs(estimate: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
    """Return the broadcast transforms as two flat lists, and the batch shape of the result."""
    batch = np.broadcast_shapes(estimate.shape[:-2], truth.shape[:-2])
    flat = (np.broadcast_to(T, (*batch, 4, 4)).reshape(-1, 4, 4) for T in (estimate, truth))
    return next(flat), next(flat), batch


def _affine(
    matrix: Float[np.ndarray, "*batch 4 4"], points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "*batch n 3"]:
    """Apply the top three rows of any 4 x 4 matrix, such as a difference of transforms, to points."""
    return points @ np.swapaxes(matrix[..., :3, :3], -1, -2) + matrix[..., None, :3, 3]
