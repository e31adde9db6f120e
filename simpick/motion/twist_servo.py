"""`TwistServo`: TCP velocities to joint commands, by differential inverse kinematics under joint and speed limits."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.motion.kinematics import Kinematics
from simpick.scene.workspace import Box

MAX_LEAD_RAD = 0.03
"""A joint's command runs ahead of the joint by no more than this, so that an arm that is blocked presses with a
bounded force and turns back at once."""

MAX_ACCELERATION_RAD_S2 = 25.0
"""Of every joint's command: over the bin, a TCP at 0.25 m/s can turn back within one tick of 50 ms."""

# Next to the squared singular values of the Jacobian, 0.01 and more away from singularities.
_DAMPING = 1e-4
_POSITION_WINDUP_M = 0.002
_ROTATION_WINDUP_RAD = np.deg2rad(0.5)
# The solver wants a box with an interior.
_LEAST_WIDTH_RAD = 1e-13
_SIGNS = np.array([[-1.0], [1.0]])


class TwistServo:
    """Follows a commanded TCP velocity with one damped least-squares step (Wampler 1986) per control period.

    The commanded pose is integrated exactly and the joints follow it, so that errors of linearisation do not add up:
    a translation keeps orientation and line. Motion that joint and speed limits do not allow is dropped, not
    caught up later.

    Each step dq minimises |J dq - error|^2 + damping |dq|^2 in a box that bounds position, speed and acceleration of
    every joint: MuJoCo's `mju_boxQP`, on arrays allocated once.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        q_start: Float[np.ndarray, "joints"],
        speed_limit_rad_s: float,
        workspace: Box,
        periods_s: Sequence[float],
    ) -> None:
        """Start at rest at `q_start`. No joint is commanded beyond the speed limit; the TCP stays in `workspace`.

        `periods_s` are the control periods between two calls of `commands`.
        """
        model = kinematics.model
        joints = model.nv
        self._model, self._data = model, mujoco.MjData(model)
        self._site = model.site(kinematics.tcp_site).id
        self._stops = np.stack([kinematics.q_lower, kinematics.q_upper])
        self._lower_m, self._upper_m = np.array(workspace.lower_m), np.array(workspace.upper_m)
        self._periods_s = tuple(periods_s)
        periods = np.array(periods_s)[:, None]
        self._share = (np.cumsum(periods, axis=0) - periods / 2) / periods.sum()
        self._duration_s = periods
        # Arrays rather than numbers, which numpy would convert in every operation.
        self._speed_limit = np.full((2, joints), speed_limit_rad_s)
        self._speed_limit_down = -self._speed_limit
        self._change = [MAX_ACCELERATION_RAD_S2 * p * _SIGNS * np.ones((2, joints)) for p in periods_s]
        self._width = _LEAST_WIDTH_RAD * _SIGNS * np.ones((2, joints))
        self._damping = _DAMPING * np.eye(joints)
        # The TCP at `_q`. The first two and `_qpos` are MuJoCo's own memory.
        self._position_m, self._xmat = self._data.site_xpos[self._site], self._data.site_xmat[self._site]
        self._qpos, self._rotation = self._data.qpos, self._xmat.reshape(3, 3)
        self._quat = np.zeros(4)
        # Where the TCP is commanded to be.
        self._goal_m, self._goal_quat = np.zeros(3), np.zeros(4)
        # Work space of `_follow`.
        self._turn, self._turned, self._off_rad, self._off_m = np.zeros(4), np.zeros(4), np.zeros(3), np.zeros(3)
        self._jacobian, self._error = np.zeros((6, joints)), np.zeros(6)
        self._jacobian_linear, self._jacobian_angular = self._jacobian[:3], self._jacobian[3:]
        self._jacobian_transposed, self._error_linear, self._error_angular = (
            self._jacobian.T,
            self._error[:3],
            self._error[3:],
        )
        self._hessian, self._gradient = np.zeros((joints, joints)), np.zeros(joints)
        self._step, self._factor = np.zeros(joints), np.zeros((joints, joints + 7))
        self._free = np.zeros(joints, np.int32)
        self._box, self._to_stops = np.zeros((2, joints)), np.zeros((2, joints))
        self._least, self._most = self._box
        self._to_lower, self._to_upper = self._to_stops
        self._speed_rad_s, self._twist = np.zeros(joints), np.zeros(6)
        self._q = np.array(q_start, float)
        self._reach()
        self._give_up_rest()

    def commands(
        self, twist_world: Float[np.ndarray, "6"], q_measured: Float[np.ndarray, "joints"]
    ) -> tuple[Float[np.ndarray, "periods joints"], Float[np.ndarray, "periods joints"]]:
        """Return joint angles (rad) and speeds (rad/s) for the end of each of the coming control periods.

        `twist_world` is the TCP's linear velocity (m/s) and its angular velocity (rad/s) about the TCP, both in world
        axes. The velocity changes linearly from the last call's to this one's over the periods.
        """
        lead = self._q - q_measured
        if np.abs(lead).max() > MAX_LEAD_RAD:
            q = q_measured + np.clip(lead, -MAX_LEAD_RAD, MAX_LEAD_RAD)
            self._q[:] = np.clip(q, *self._stops)
            self._reach()
            self._give_up_rest()
        twists = self._twist + self._share * (twist_world - self._twist)
        qs = np.empty((len(self._periods_s), len(self._q)))
        speeds_rad_s = np.empty_like(qs)
        for k, (shift, turn, period_s) in enumerate(
            zip(twists[:, :3] * self._duration_s, twists[:, 3:], self._periods_s, strict=True)
        ):
            self._follow(shift, turn, period_s, self._change[k])
            qs[k], speeds_rad_s[k] = self._q, self._speed_rad_s
        self._twist = np.array(twist_world, float)
        return qs, speeds_rad_s

    def _follow(
        self,
        shift_m: Float[np.ndarray, "3"],
        turn_rad_s: Float[np.ndarray, "3"],
        period_s: float,
        change: Float[np.ndarray, "2 joints"],
    ) -> None:
        """Move the commanded pose, and the joints after it, by one period; all speeds may change by `change`."""
        goal_m, goal_quat, q = self._goal_m, self._goal_quat, self._q
        np.add(goal_m, shift_m, out=goal_m)
        np.maximum(goal_m, self._lower_m, out=goal_m)
        np.minimum(goal_m, self._upper_m, out=goal_m)
        self._turn[:] = 1.0, 0.0, 0.0, 0.0
        mujoco.mju_quatIntegrate(self._turn, turn_rad_s, period_s)
        mujoco.mju_mulQuat(self._turned, self._turn, goal_quat)
        mujoco.mju_normalize4(self._turned)
        goal_quat[:] = self._turned

        mujoco.mj_jacSite(self._model, self._data, self._jacobian_linear, self._jacobian_angular, self._site)
        # The error points from the goal to the TCP, so that it needs no sign in the gradient.
        np.subtract(self._position_m, goal_m, out=self._error_linear)
        mujoco.mju_subQuat(self._off_rad, self._quat, goal_quat)
        np.dot(self._rotation, self._off_rad, out=self._error_angular)
        np.dot(self._jacobian_transposed, self._jacobian, out=self._hessian)
        np.add(self._hessian, self._damping, out=self._hessian)
        np.dot(self._error, self._jacobian, out=self._gradient)

        self._bound_step(period_s, change)
        # The damping makes the matrix positive definite, without which there would be no solution.
        mujoco.mju_boxQP(self._step, self._factor, self._free, self._hessian, self._gradient, self._least, self._most)
        np.add(q, self._step, out=q)
        # By a bit of rounding, or by the least width, a step may lead beyond a stop.
        np.maximum(q, self._stops[0], out=q)
        np.minimum(q, self._stops[1], out=q)
        np.divide(self._step, period_s, out=self._speed_rad_s)

        self._reach()
        off_m, off_rad = self._off_m, self._off_rad
        np.subtract(goal_m, self._position_m, out=off_m)
        mujoco.mju_subQuat(off_rad, goal_quat, self._quat)
        if off_m.dot(off_m) >= _POSITION_WINDUP_M**2 or off_rad.dot(off_rad) >= _ROTATION_WINDUP_RAD**2:
            self._give_up_rest()

    def _bound_step(self, period_s: float, change: Float[np.ndarray, "2 joints"]) -> None:
        """Bound every joint's next step in position, speed and acceleration.

        Where they contradict each other, as in front of a stop that is reached too fast, position counts most and
        acceleration least: the box always has an interior.
        """
        box = self._box
        np.add(change, self._speed_rad_s, out=box)
        np.maximum(box, self._speed_limit_down, out=box)
        np.minimum(box, self._speed_limit, out=box)
        np.multiply(box, period_s, out=box)
        np.subtract(self._stops, self._q, out=self._to_stops)
        np.maximum(box, self._to_lower, out=box)
        np.minimum(box, self._to_upper, out=box)
        np.add(box, self._width, out=box)

    def _reach(self) -> None:
        """Compute the TCP at the present joint angles."""
        self._qpos[:] = self._q
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mju_mat2Quat(self._quat, self._xmat)

    def _give_up_rest(self) -> None:
        """Command the pose that was reached."""
        self._goal_m[:] = self._position_m
        self._goal_quat[:] = self._quat
