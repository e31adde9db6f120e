"""Rigid transforms in numpy: SO(3) and SE(3), single or batched over leading dimensions, in float64.

SciPy's `Rotation` computes `rotation_angle` and is the test oracle of the other conversions. It is up to 7 times as
fast, but differs in the last bit, and bins are drawn through these functions: contact dynamics amplify one bit to
settled poses that differ by up to 7 mm, so that a seed would no longer name the same bin. `invert` is 10 times as fast
as `RigidTransform.inv` with its conversions.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation


def transform(
    rotation: Float[np.ndarray, "*#batch 3 3"] | None = None,
    translation: Float[np.ndarray, "*#batch 3"] | None = None,
) -> Float[np.ndarray, "*batch 4 4"]:
    """Return T_a_b from its rotation (identity if None) and translation in metres (zero if None), broadcast."""
    rotation = np.eye(3) if rotation is None else np.asarray(rotation, float)
    translation = np.zeros(3) if translation is None else np.asarray(translation, float)
    batch = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    T = np.zeros((*batch, 4, 4))
    T[..., :3, :3] = rotation
    T[..., :3, 3] = translation
    T[..., 3, 3] = 1.0
    return T


def invert(T_a_b: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 4 4"]:
    """Return T_b_a."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return transform(R_b_a, -(R_b_a @ T_a_b[..., :3, 3:])[..., 0])


def transform_points(
    T_a_b: Float[np.ndarray, "*#batch 4 4"], points_b: Float[np.ndarray, "*#batch n 3"]
) -> Float[np.ndarray, "*batch n 3"]:
    """Map points from frame b to frame a; batches of transforms and of point clouds broadcast."""
    return points_b @ np.swapaxes(T_a_b[..., :3, :3], -1, -2) + T_a_b[..., None, :3, 3]


def skew(vector: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the matrix [v]x with [v]x w = v x w."""
    x, y, z = np.moveaxis(np.asarray(vector, float), -1, 0)
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*x.shape, 3, 3)


def so3_exp(rotation_vector: Float[np.ndarray, "*batch 3"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the rotation about `rotation_vector` by its norm in radians (Rodrigues), exact near zero."""
    w = np.asarray(rotation_vector, float)
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    # sinc(x) is sin(pi x) / (pi x): both factors stay exact as the angle goes to zero.
    a = np.sinc(angle / np.pi)
    b = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    W = skew(w)
    return np.eye(3) + a * W + b * (W @ W)


def so3_log(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 3"]:
    """Return the rotation vector in radians, of norm in [0, pi]."""
    q = quaternion_from_matrix(R)
    imaginary_norm = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(imaginary_norm, q[..., :1])
    scale = np.where(imaginary_norm > 1e-12, angle / np.maximum(imaginary_norm, 1e-12), 2.0)
    return scale * q[..., 1:]


def quaternion_from_matrix(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 4"]:
    """Return the unit quaternion wxyz with w >= 0 (Shepperd's method: the largest component is never divided by)."""
    R = np.asarray(R, float)
    trace = np.trace(R, axis1=-2, axis2=-1)
    xx, yy, zz = R[..., 0, 0], R[..., 1, 1], R[..., 2, 2]
    wx, wy, wz = R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]
    xy, xz, yz = R[..., 1, 0] + R[..., 0, 1], R[..., 2, 0] + R[..., 0, 2], R[..., 2, 1] + R[..., 1, 2]
    candidates = np.stack(
        [
            np.stack([1 + trace, wx, wy, wz], -1),
            np.stack([wx, 1 + xx - yy - zz, xy, xz], -1),
            np.stack([wy, xy, 1 - xx + yy - zz, yz], -1),
            np.stack([wz, xz, yz, 1 - xx - yy + zz], -1),
        ],
        axis=-2,
    )
    best = np.argmax(np.stack([trace, xx, yy, zz], -1), axis=-1)
    q = np.take_along_axis(candidates, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def matrix_from_quaternion(q: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the rotation matrix of a quaternion wxyz of any non-zero norm."""
    q = np.asarray(q, float)
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    w, v = q[..., :1, None], q[..., 1:]
    V = skew(v)
    return np.eye(3) + 2 * w * V + 2 * (V @ V)


def rotation_to_6d(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 6"]:
    """Return the first two columns of R, one after the other (Zhou et al. 2019): continuous over all of SO(3)."""
    return np.concatenate([R[..., :, 0], R[..., :, 1]], axis=-1)


def rotation_from_6d(columns: Float[np.ndarray, "*batch 6"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Return the rotation whose first two columns are `columns`, made orthonormal (Gram-Schmidt, Zhou et al. 2019).

    Defined for every input, so that any action of a policy is a rotation: a first column of zeros is replaced by +x, a
    second that is zero or parallel to the first by the coordinate axis that is least aligned with the first.
    """
    x = _normalized_or(columns[..., :3], np.array([1.0, 0.0, 0.0]))
    y = columns[..., 3:] - (columns[..., 3:] * x).sum(-1, keepdims=True) * x
    axis = np.eye(3)[np.argmin(np.abs(x), axis=-1)]
    y = _normalized_or(y, axis - (axis * x).sum(-1, keepdims=True) * x)
    # Repeated, because a nearly parallel second column loses digits in the subtraction above.
    y = _normalized_or(y - (y * x).sum(-1, keepdims=True) * x, y)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _normalized_or(
    vector: Float[np.ndarray, "*batch 3"], fallback: Float[np.ndarray, "*#batch 3"]
) -> Float[np.ndarray, "*batch 3"]:
    """Return unit vectors, from `fallback` where `vector` is too short to have a direction."""
    vector = np.where(np.linalg.norm(vector, axis=-1, keepdims=True) < 1e-9, fallback, vector)
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def rotation_angle(R: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch"]:
    """Return the angle of a rotation in radians, in [0, pi], accurate near both ends."""
    return np.asarray(Rotation.from_matrix(R, assume_valid=True).magnitude())


def random_rotation(rng: np.random.Generator, shape: tuple[int, ...] = ()) -> Float[np.ndarray, "*batch 3 3"]:
    """Return uniformly distributed rotations (normalized Gaussian quaternions)."""
    return matrix_from_quaternion(rng.normal(size=(*shape, 4)))


def look_at(
    eye: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"] | None = None
) -> Float[np.ndarray, "4 4"]:
    """Return T_world_camera (OpenCV axes) of a camera at `eye` that looks at `target`; `up` defaults to world +z.

    Where the view direction is parallel to `up`, world +x becomes the image's up direction.
    """
    up = np.array([0.0, 0.0, 1.0]) if up is None else np.asarray(up, float)
    forward = np.asarray(target, float) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, up)
    if np.linalg.norm(right) < 1e-9:
        right = np.cross(forward, [1.0, 0.0, 0.0])
    if np.linalg.norm(right) < 1e-9:
        right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    return transform(np.stack([right, np.cross(forward, right), forward], axis=-1), eye)
