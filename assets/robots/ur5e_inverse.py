"""Closed-form inverse kinematics of the UR family: the seeds from which mink's solver starts.

Hawkins, K. P., "Analytic inverse kinematics for the Universal Robots UR-5/UR-10 arms", Georgia Tech, 2013.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from simpick.assets.robots.ur5e import DH_A_M, DH_D_M, T_BASE_DH, link_transform
from simpick.geometry.transforms import invert

_D4, _D6 = DH_D_M[3], DH_D_M[5]
_A2, _A3 = DH_A_M[1], DH_A_M[2]


def forward(q: Float[np.ndarray, "6"]) -> Float[np.ndarray, "4 4"]:
    """Return T_base_flange by the product of the Denavit-Hartenberg transforms."""
    T = T_BASE_DH
    for i in range(6):
        T = T @ _joint_transform(i, float(q[i]))
    return T


def inverse(T_base_flange: Float[np.ndarray, "4 4"], q_near: Float[np.ndarray, "6"]) -> Float[np.ndarray, "n 6"]:
    """Return all (at most eight) joint vectors that reach the pose, each angle within pi of `q_near`'s, in radians.

    An empty array means out of reach. Where the wrist is singular the last joint keeps `q_near`'s angle.
    """
    T = invert(T_BASE_DH) @ T_base_flange
    wrist = T[:3, 3] - _D6 * T[:3, 2]
    radius = np.hypot(wrist[0], wrist[1])
    if radius < _D4:
        return np.zeros((0, 6))
    solutions = []
    azimuth, swing = np.arctan2(wrist[1], wrist[0]), np.arccos(_D4 / radius)
    for q1 in (azimuth + swing + np.pi / 2, azimuth - swing + np.pi / 2):
        s1, c1 = np.sin(q1), np.cos(q1)
        cosine = (T[0, 3] * s1 - T[1, 3] * c1 - _D4) / _D6
        if abs(cosine) > 1 + 1e-9:
            continue
        for q5 in (np.arccos(np.clip(cosine, -1, 1)), -np.arccos(np.clip(cosine, -1, 1))):
            s5 = np.sin(q5)
            if abs(s5) < 1e-6:
                q6 = float(q_near[5])
            else:
                q6 = np.arctan2((T[1, 1] * c1 - T[0, 1] * s1) / s5, (T[0, 0] * s1 - T[1, 0] * c1) / s5)
            T_1_4 = invert(_joint_transform(0, q1)) @ T @ invert(_joint_transform(4, q5) @ _joint_transform(5, q6))
            solutions += [(q1, q2, q3, q4, q5, q6) for q2, q3, q4 in _planar(T_1_4)]
    if not solutions:
        return np.zeros((0, 6))
    q = np.asarray(solutions)
    return q - 2 * np.pi * np.round((q - q_near) / (2 * np.pi))


def _planar(T_1_4: Float[np.ndarray, "4 4"]) -> list[tuple[float, float, float]]:
    """Return the angles of shoulder lift, elbow and wrist 1: a planar chain of three links."""
    p = T_1_4[:3, 3] - _D4 * T_1_4[:3, 1]
    length_squared = p[0] ** 2 + p[1] ** 2
    cosine = (length_squared - _A2**2 - _A3**2) / (2 * _A2 * _A3)
    if abs(cosine) > 1:
        return []
    solutions = []
    for q3 in (np.arccos(cosine), -np.arccos(cosine)):
        # Links point along -x of their frames (a2, a3 < 0), hence the signs.
        q2 = np.arctan2(-p[1], -p[0]) - np.arctan2(-_A3 * np.sin(q3), -_A2 - _A3 * np.cos(q3))
        T_3_4 = invert(_joint_transform(1, q2) @ _joint_transform(2, q3)) @ T_1_4
        solutions.append((float(q2), float(q3), float(np.arctan2(T_3_4[1, 0], T_3_4[0, 0]))))
    return solutions


def _joint_transform(joint: int, angle: float) -> Float[np.ndarray, "4 4"]:
    c, s = np.cos(angle), np.sin(angle)
    R = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    return R @ link_transform(joint)
