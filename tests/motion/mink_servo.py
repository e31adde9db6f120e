"""Differential inverse kinematics by mink and a general QP solver: the reference that `TwistServo` is compared with."""

from __future__ import annotations

from collections.abc import Sequence

import mink
import numpy as np

from simpick.geometry.transforms import rotation_angle, so3_exp
from simpick.motion.kinematics import Kinematics
from simpick.motion.twist_servo import MAX_ACCELERATION_RAD_S2


class _JointMotionLimit(mink.Limit):
    """Bounds of joint position, speed and acceleration around the next step."""

    def __init__(self, kinematics: Kinematics, speed_limit_rad_s: float) -> None:
        self._kinematics, self._speed_limit_rad_s = kinematics, speed_limit_rad_s
        self.speed_rad_s = np.zeros_like(kinematics.q_lower)

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> mink.Constraint:
        change, limit = MAX_ACCELERATION_RAD_S2 * dt, self._speed_limit_rad_s
        lower, upper = self.speed_rad_s - change, self.speed_rad_s + change
        stops = [(stop - configuration.q) / dt for stop in (self._kinematics.q_lower, self._kinematics.q_upper)]
        for least, most in ((-limit, limit), stops):
            lower, upper = np.clip(lower, least, most), np.clip(upper, least, most)
        eye = np.eye(len(lower))
        return mink.Constraint(np.concatenate([eye, -eye]), np.concatenate([upper, -lower]) * dt)


def mink_commands(
    kinematics: Kinematics,
    q_start: np.ndarray,
    twists: np.ndarray,
    periods_s: Sequence[float],
    speed_limit_rad_s: float,
) -> np.ndarray:
    """Return the joint angles at the end of each control period of an arm that obeys at once, from rest."""
    task = mink.FrameTask(kinematics.tcp_site, "site", position_cost=1.0, orientation_cost=1.0)
    limit = _JointMotionLimit(kinematics, speed_limit_rad_s)
    configuration = mink.Configuration(kinematics.model)
    q, before, T_world_tcp = np.array(q_start), np.zeros(6), kinematics.forward(q_start)
    qs = []
    for twist in twists:
        elapsed_s = 0.0
        for period_s in periods_s:
            now = before + (elapsed_s + period_s / 2) / sum(periods_s) * (twist - before)
            elapsed_s += period_s
            T_goal = T_world_tcp.copy()
            T_goal[:3, 3] += now[:3] * period_s
            T_goal[:3, :3] = so3_exp(now[3:] * period_s) @ T_goal[:3, :3]
            configuration.update(q)
            task.set_target(mink.SE3.from_matrix(T_goal))
            speed = mink.solve_ik(configuration, [task], period_s, "daqp", damping=1e-4, limits=[limit])
            limit.speed_rad_s = speed
            q = np.clip(q + speed * period_s, kinematics.q_lower, kinematics.q_upper)
            T_reached = kinematics.forward(q)
            behind_m = np.linalg.norm(T_goal[:3, 3] - T_reached[:3, 3])
            behind_rad = rotation_angle(T_goal[:3, :3].T @ T_reached[:3, :3])
            T_world_tcp = T_goal if behind_m < 0.002 and behind_rad < np.deg2rad(0.5) else T_reached
            qs.append(q)
        before = twist
    return np.array(qs)
