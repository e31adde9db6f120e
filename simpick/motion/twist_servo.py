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

_SOLVER = "daqp"
# Next to the squared singular values of the Jacobian, 0.01 and more away from singularities.
_DAMPING = 1e-4
_POSITION_WINDUP_M = 0.002
_ROTATION_WINDUP_RAD = np.deg2rad(0.5)


class TwistServo:
    """Follows a commanded TCP velocity with one quadratic program (mink) a control period.

    The commanded pose is integrated exactly and the joints follow it, so that errors of linearisation do not add up:
    a translation keeps orientation and line. What joints and speed limits do not allow is given up, not made up for
    later.
    """

    def __init__(
        self, kinematics: Kinematics, q_start: Float[np.ndarray, "joints"], speed_limit_rad_s: float, workspace: Box
    ) -> None:
        """Start at rest at `q_start`. No joint is told to move faster than the limit; the TCP stays in `workspace`."""
        self._kinematics = kinematics
        self._workspace = workspace
        self._task = mink.FrameTask(kinematics.tcp_site, "site", position_cost=1.0, orientation_cost=1.0)
        model = kinematics.model
        speeds = {model.joint(k).name: speed_limit_rad_s for k in range(model.njnt)}
        self._limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]
        self._configuration = mink.Configuration(model)
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
        try:
            speed = mink.solve_ik(
                self._configuration, [self._task], period_s, _SOLVER, damping=_DAMPING, limits=self._limits
            )
        except mink.NoSolutionFound:
            speed = np.zeros_like(self._q)
        self._q = np.clip(self._q + speed * period_s, self._kinematics.q_lower, self._kinematics.q_upper)
        T_reached = self._kinematics.forward(self._q)
        behind_m = np.linalg.norm(T_goal[:3, 3] - T_reached[:3, 3])
        behind_rad = rotation_angle(T_goal[:3, :3].T @ T_reached[:3, :3])
        followed = behind_m < _POSITION_WINDUP_M and behind_rad < _ROTATION_WINDUP_RAD
        self._T_world_tcp = T_goal if followed else T_reached
        return self._q.copy(), speed
