"""Closed-form inverse kinematics of the UR family: the seeds from which mink's solver starts.

Hawkins, K. P., "Analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms", Georgia Tech, 2013.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from simpick.assets.robots.ur5e import DH_A_M, DH_D_M, T_BASE_DH, link_transform
from simpick.geometry.transforms import invert

_D4, _D6 = DH_D_M[3], DH_D_M[5]
_A2, _A3 = DH_A_M[1], DH_A_M[2]
_LINKS = tuple(link_transform(joint) for joint in range(6))
_T_DH_BASE = invert(T_BASE_DH)


def forward(q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4 4"]:
    """Return T_base_flange by the product of the Denavit-Hartenberg transforms."""
    T = T_BASE_DH
    for i in range(6):
        T = T @ _joint_transforms(i, q[i : i + 1])[0]
    return T


def inverse(T_base_flange: Float[np.ndarray, "4 4"], q_near: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n 6"]:
    """Return all (at most eight) joint vectors that reach the pose, each angle within pi of `q_near`'s, in radians.

    An empty array means out of reach. Where the wrist is singular the last joint keeps `q_near`'s angle.
    """
    T = _T_DH_BASE @ T_base_flange
    wrist = T[:3, 3] - _D6 * T[:3, 2]
    radius = np.hypot(wrist[0], wrist[1])
    if radius < _D4:
        return np.zeros((0, 6))
    azimuth, swing = np.arctan2(wrist[1], wrist[0]), np.arccos(_D4 / radius)
    q1 = np.array([azimuth + swing + np.pi / 2, azimuth - swing + np.pi / 2])
    s1, c1 = np.sin(q1), np.cos(q1)
    cosine = (T[0, 3] * s1 - T[1, 3] * c1 - _D4) / _D6
    reached = np.repeat(np.flatnonzero(np.abs(cosine) <= 1 + 1e-9), 2)
    q1, s1, c1 = q1[reached], s1[reached], c1[reached]
    q5 = np.arccos(np.clip(cosine[reached], -1, 1))
    q5[1::2] *= -1
    s5 = np.sin(q5)
    singular = np.abs(s5) < 1e-6
    s5[singular] = 1.0
    q6 = np.arctan2((T[1, 1] * c1 - T[0, 1] * s1) / s5, (T[0, 0] * s1 - T[1, 0] * c1) / s5)
    q6[singular] = q_near[5]
    T_1_4 = invert(_joint_transforms(0, q1)) @ T @ invert(_joint_transforms(4, q5) @ _joint_transforms(5, q6))
    branches, q2, q3, q4 = _planar(T_1_4)
    q = np.stack([q1[branches], q2, q3, q4, q5[branches], q6[branches]], axis=1)
    return q - 2 * np.pi * np.round((q - q_near) / (2 * np.pi))


def _planar(
    T_1_4: Float[np.ndarray, "n 4 4"],
) -> tuple[
    Int[np.ndarray, "solutions"],
    Float[np.ndarray, "solutions"],
    Float[np.ndarray, "solutions"],
    Float[np.ndarray, "solutions"],
]:
    """Return the angles of shoulder lift, elbow and wrist 1, a planar chain of three links, and the pose of each."""
    p = T_1_4[:, :3, 3] - _D4 * T_1_4[:, :3, 1]
    length_squared = p[:, 0] ** 2 + p[:, 1] ** 2
    cosine = (length_squared - _A2**2 - _A3**2) / (2 * _A2 * _A3)
    branches = np.repeat(np.flatnonzero(np.abs(cosine) <= 1), 2)
    p, q3 = p[branches], np.arccos(cosine[branches])
    q3[1::2] *= -1
    # Links point along -x of their frames (a2, a3 < 0), hence the signs.
    q2 = np.arctan2(-p[:, 1], -p[:, 0]) - np.arctan2(-_A3 * np.sin(q3), -_A2 - _A3 * np.cos(q3))
    T_3_4 = invert(_joint_transforms(1, q2) @ _joint_transforms(2, q3)) @ T_1_4[branches]
    return branches, q2, q3, np.arctan2(T_3_4[:, 1, 0], T_3_4[:, 0, 0])


def _joint_transforms(joint: int, angles: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 4 4"]:
    rotation = np.zeros((len(angles), 4, 4))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(angles)
    rotation[:, 1, 0] = np.sin(angles)
    rotation[:, 0, 1] = -rotation[:, 1, 0]
    rotation[:, 2, 2] = rotation[:, 3, 3] = 1.0
    return rotation @ _LINKS[joint]
