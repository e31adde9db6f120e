"""`TwistServo`: TCP velocities to joint commands, by differential inverse kinematics under joint and speed limits."""

from __future__ import annotations

from collections.abc import Sequence

import mink
import numpy as np
from jaxtyping import Float

from simpick.geometry.transforms import rotation_angle, so3_exp
from simpick.motion.kinematics import Kinematics
from simpick.scene.workspace import Box

MAX_LEAD_RAD = 0.03
"""A joint's command runs ahead of the joint by no more than this, so that an arm that is blocked presses with a
bounded force and turns back at once."""

MAX_ACCELERATION_RAD_S2 = 25.0
"""Of every joint's command: over the bin, a TCP at 0.25 m/s can turn back within one tick of 50 ms."""

_SOLVER = "daqp"
# Next to the squared singular values of the Jacobian, 0.01 and more away from singularities.
_DAMPING = 1e-4
_POSITION_WINDUP_M = 0.002
_ROTATION_WINDUP_RAD = np.deg2rad(0.5)


class JointMotionLimit(mink.Limit):
    """Bounds of joint position, speed and acceleration, as one box around the next step of every joint.

    Where they contradict each other, as in front of a stop that is reached too fast, position counts most and
    acceleration least: the box is never empty.
    """

    def __init__(
        self, q_lower: Float[np.ndarray, "joints"], q_upper: Float[np.ndarray, "joints"], speed_limit_rad_s: float
    ) -> None:
        """Start at rest; set `speed_rad_s` to the joints' speed before each step."""
        self._q_lower, self._q_upper = q_lower, q_upper
        self._speed_limit_rad_s = speed_limit_rad_s
        self.speed_rad_s = np.zeros_like(q_lower)

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> mink.Constraint:
        """Return G and h of G dq <= h for a step of `dt` seconds."""
        change = MAX_ACCELERATION_RAD_S2 * dt
        lower, upper = self.speed_rad_s - change, self.speed_rad_s + change
        limit = self._speed_limit_rad_s
        to_stops = (self._q_lower - configuration.q) / dt, (self._q_upper - configuration.q) / dt
        for least, most in ((-limit, limit), to_stops):
            lower, upper = np.clip(lower, least, most), np.clip(upper, least, most)
        eye = np.eye(len(lower))
        return mink.Constraint(np.concatenate([eye, -eye]), np.concatenate([upper, -lower]) * dt)


class TwistServo:
    """Follows a commanded TCP velocity with one quadratic program (mink) a control period.

    The commanded pose is integrated exactly and the joints follow it, so that errors of linearisation do not add up:
    a translation keeps orientation and line. Motion that joint and speed limits do not allow is dropped, not
    caught up later.
    """

    def __init__(
        self, kinematics: Kinematics, q_start: Float[np.ndarray, "joints"], speed_limit_rad_s: float, workspace: Box
    ) -> None:
        """Start at rest at `q_start`. No joint is commanded beyond the speed limit; the TCP stays in `workspace`."""
        self._kinematics = kinematics
        self._workspace = workspace
        self._task = mink.FrameTask(kinematics.tcp_site, "site", position_cost=1.0, orientation_cost=1.0)
        self._limit = JointMotionLimit(kinematics.q_lower, kinematics.q_upper, speed_limit_rad_s)
        self._configuration = mink.Configuration(kinematics.model)
        self._q = np.array(q_start, float)
        self._twist = np.zeros(6)
        self._T_world_tcp = kinematics.forward(self._q)

    def commands(
        self,
        twist_world: Float[np.ndarray, "6"],
        q_measured: Float[np.ndarray, "joints"],
        periods_s: Sequence[float],
    ) -> list[tuple[Float[np.ndarray, "joints"], Float[np.ndarray, "joints"]]]:
        """Return joint angles (rad) and speeds (rad/s) for the end of each of the coming control periods.

        `twist_world` is the TCP's linear velocity (m/s) and its angular velocity (rad/s) about the TCP, both in world
        axes. The velocity changes linearly from the last call's to this one's over the periods.
        """
        lead = self._q - q_measured
        if np.abs(lead).max() > MAX_LEAD_RAD:
            q = q_measured + np.clip(lead, -MAX_LEAD_RAD, MAX_LEAD_RAD)
            self._q = np.clip(q, self._kinematics.q_lower, self._kinematics.q_upper)
            self._T_world_tcp = self._kinematics.forward(self._q)
        before, total_s, elapsed_s = self._twist, float(np.sum(periods_s)), 0.0
        commands = []
        for period_s in periods_s:
            share = (elapsed_s + period_s / 2) / total_s
            commands.append(self._follow(before + share * (twist_world - before), period_s))
            elapsed_s += period_s
        self._twist = np.array(twist_world, float)
        return commands

    def _follow(
        self, twist_world: Float[np.ndarray, "6"], period_s: float
    ) -> tuple[Float[np.ndarray, "joints"], Float[np.ndarray, "joints"]]:
        T_goal = self._T_world_tcp.copy()
        T_goal[:3, 3] = np.clip(
            T_goal[:3, 3] + twist_world[:3] * period_s, self._workspace.lower_m, self._workspace.upper_m
        )
        T_goal[:3, :3] = so3_exp(twist_world[3:] * period_s) @ T_goal[:3, :3]
        self._configuration.update(self._q)
        self._task.set_target(mink.SE3.from_matrix(T_goal))
        speed = mink.solve_ik(
            self._configuration, [self._task], period_s, _SOLVER, damping=_DAMPING, limits=[self._limit]
        )
        self._limit.speed_rad_s = speed
        self._q = np.clip(self._q + speed * period_s, self._kinematics.q_lower, self._kinematics.q_upper)
        T_reached = self._kinematics.forward(self._q)
        behind_m = np.linalg.norm(T_goal[:3, 3] - T_reached[:3, 3])
        behind_rad = rotation_angle(T_goal[:3, :3].T @ T_reached[:3, :3])
        followed = behind_m < _POSITION_WINDUP_M and behind_rad < _ROTATION_WINDUP_RAD
        self._T_world_tcp = T_goal if followed else T_reached
        return self._q.copy(), speed
