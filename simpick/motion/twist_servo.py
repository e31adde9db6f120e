"""`TwistServo`: TCP velocities to joint commands, by differential inverse kinematics under joint and speed limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

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
# Of unit quaternions whose rotations differ by the angle above.
_ROTATION_WINDUP_DOT = math.cos(_ROTATION_WINDUP_RAD / 2)
# The solver wants a box with an interior.
_LEAST_WIDTH_RAD = 1e-13


@dataclass(frozen=True, eq=False)
class _Period:
    """One control period of a tick."""

    duration_s: float
    shift_m: Float[np.ndarray, "3"]
    """Motion of the commanded TCP."""
    conjugate_turn_rad_s: Float[np.ndarray, "3"]
    """Its angular velocity, negated: that of a conjugate."""
    step_before_rad: Float[np.ndarray, "joints"]
    """Motion of the joints in the period before, which for the first is the last one of the last tick."""
    ratio: Float[np.ndarray, "joints"]
    """Duration of this period by that of the period before. Arrays, for numpy would convert numbers every time."""
    least_change_rad: Float[np.ndarray, "joints"]
    most_change_rad: Float[np.ndarray, "joints"]
    """How much motion may differ from that at the speed before."""
    least_step_rad: Float[np.ndarray, "joints"]
    most_step_rad: Float[np.ndarray, "joints"]
    """At the limits of speed."""
    step_rad: Float[np.ndarray, "joints"]
    q: Float[np.ndarray, "joints"]
    """Where the period leads."""


class TwistServo:
    """Follows a commanded TCP velocity with one damped least-squares step (Wampler 1986) per control period.

    The commanded pose is integrated exactly and the joints follow it, so that errors of linearisation do not add up:
    a translation keeps orientation and line. Motion that joint and speed limits do not allow is dropped, not
    caught up later.

    Each step dq minimises |J dq - error|^2 + damping |dq|^2 in a box that bounds position, speed and acceleration of
    every joint: MuJoCo's `mju_boxQP`, on arrays allocated once. Rotations are conjugate quaternions, with which
    `mju_quatIntegrate` turns about the world's axes and `mju_subQuat` gives the difference in them.
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
        self._lower_m, self._upper_m = np.array(workspace.lower_m), np.array(workspace.upper_m)
        durations = np.array(periods_s)[:, None]
        self._share = (np.cumsum(durations, axis=0) - durations / 2) / durations.sum()
        # From twists to shifts in m and angular velocities of conjugates.
        self._scale = np.concatenate([durations.repeat(3, axis=1), -np.ones((len(periods_s), 3))], axis=1)
        self._twist, self._motions = np.zeros(6), np.zeros((len(periods_s), 6))
        self._qs, self._steps_rad = np.zeros((2, len(periods_s), joints))
        each = np.ones(joints)
        self._periods = [
            _Period(
                duration_s=duration_s,
                shift_m=self._motions[k, :3],
                conjugate_turn_rad_s=self._motions[k, 3:],
                step_before_rad=self._steps_rad[k - 1],
                ratio=duration_s / periods_s[k - 1] * each,
                least_change_rad=-MAX_ACCELERATION_RAD_S2 * duration_s**2 * each,
                most_change_rad=MAX_ACCELERATION_RAD_S2 * duration_s**2 * each,
                least_step_rad=-speed_limit_rad_s * duration_s * each,
                most_step_rad=speed_limit_rad_s * duration_s * each,
                step_rad=self._steps_rad[k],
                q=self._qs[k],
            )
            for k, duration_s in enumerate(periods_s)
        ]
        self._durations_s = durations
        self._stops = np.stack([kinematics.q_lower, kinematics.q_upper])
        self._width = np.outer([-_LEAST_WIDTH_RAD, _LEAST_WIDTH_RAD], each)
        self._near_stops, self._reach_rad = False, speed_limit_rad_s * float(durations.sum())
        # Joint angles and the TCP at them: MuJoCo's own memory.
        self._q = self._data.qpos
        self._position_m, self._xmat = self._data.site_xpos[self._site], self._data.site_xmat[self._site]
        self._quat, self._conjugate = np.zeros(4), np.zeros(4)
        # Where the TCP is commanded to be.
        self._goal_m, self._goal_conjugate = np.zeros(3), np.zeros(4)
        # Work space of `_follow`. Below the Jacobian stands the damping.
        self._jacobian = np.concatenate([np.zeros((6, joints)), math.sqrt(_DAMPING) * np.eye(joints)])
        self._jacobian_linear, self._jacobian_angular = self._jacobian[:3], self._jacobian[3:6]
        self._jacobian_transposed = self._jacobian.T
        self._error, self._off_m = np.zeros(6 + joints), np.zeros(3)
        self._error_linear, self._error_angular = self._error[:3], self._error[3:6]
        self._hessian, self._gradient = np.zeros((joints, joints)), np.zeros(joints)
        self._factor, self._free = np.zeros((joints, joints + 7)), np.zeros(joints, np.int32)
        self._steady_rad = np.zeros(joints)
        self._box, self._to_stops = np.zeros((2, joints)), np.zeros((2, joints))
        self._least, self._most = self._box
        self._to_lower, self._to_upper = self._to_stops
        self._q[:] = q_start
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
        if max(map(abs, lead.tolist())) > MAX_LEAD_RAD:
            self._q[:] = q_measured + np.minimum(np.maximum(lead, -MAX_LEAD_RAD), MAX_LEAD_RAD)
            self._stay_within_stops()
            self._reach()
            self._give_up_rest()
        lower, upper = self._stops
        left_rad = min(*(self._q - lower).tolist(), *(upper - self._q).tolist())
        self._near_stops = left_rad <= self._reach_rad
        twists = self._twist + self._share * (twist_world - self._twist)
        np.multiply(twists, self._scale, out=self._motions)
        for period in self._periods:
            self._follow(period)
        self._twist[:] = twist_world
        return self._qs.copy(), self._steps_rad / self._durations_s

    def _follow(self, period: _Period) -> None:
        """Move the commanded pose, and the joints after it, by one period."""
        goal_m, goal_conjugate, q, step = self._goal_m, self._goal_conjugate, self._q, period.step_rad
        np.add(goal_m, period.shift_m, out=goal_m)
        np.maximum(goal_m, self._lower_m, out=goal_m)
        np.minimum(goal_m, self._upper_m, out=goal_m)
        mujoco.mju_quatIntegrate(goal_conjugate, period.conjugate_turn_rad_s, period.duration_s)

        mujoco.mj_jacSite(self._model, self._data, self._jacobian_linear, self._jacobian_angular, self._site)
        # The error points from the goal to the TCP, so that it needs no sign in the gradient.
        np.subtract(self._position_m, goal_m, out=self._error_linear)
        mujoco.mju_subQuat(self._error_angular, goal_conjugate, self._conjugate)
        self._jacobian_transposed.dot(self._jacobian, out=self._hessian)
        self._error.dot(self._jacobian, out=self._gradient)

        self._bound_step(period)
        # The damping makes the matrix positive definite, without which there would be no solution. From rest, for from
        # the step before the solver ends early in front of a bound several times as often.
        step.fill(0.0)
        mujoco.mju_boxQP(step, self._factor, self._free, self._hessian, self._gradient, self._least, self._most)
        np.add(q, step, out=q)
        if self._near_stops:
            # By a bit of rounding, or by the least width, a step may lead beyond a stop.
            self._stay_within_stops()
        period.q[:] = q

        self._reach()
        off_m = self._off_m
        np.subtract(goal_m, self._position_m, out=off_m)
        if (
            off_m.dot(off_m) >= _POSITION_WINDUP_M**2
            or abs(goal_conjugate.dot(self._conjugate)) <= _ROTATION_WINDUP_DOT
        ):
            self._give_up_rest()

    def _bound_step(self, period: _Period) -> None:
        """Bound every joint's next step in position, speed and acceleration.

        Where they contradict each other, as in front of a stop that is reached too fast, position counts most and
        acceleration least: the box always has an interior.
        """
        box, least, most, steady = self._box, self._least, self._most, self._steady_rad
        np.multiply(period.step_before_rad, period.ratio, out=steady)
        np.add(steady, period.least_change_rad, out=least)
        np.add(steady, period.most_change_rad, out=most)
        np.maximum(least, period.least_step_rad, out=least)
        np.minimum(most, period.most_step_rad, out=most)
        if self._near_stops:
            np.subtract(self._stops, self._q, out=self._to_stops)
            np.maximum(box, self._to_lower, out=box)
            np.minimum(box, self._to_upper, out=box)
            np.add(box, self._width, out=box)

    def _stay_within_stops(self) -> None:
        np.maximum(self._q, self._stops[0], out=self._q)
        np.minimum(self._q, self._stops[1], out=self._q)

    def _reach(self) -> None:
        """Compute the TCP at the present joint angles."""
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mju_mat2Quat(self._quat, self._xmat)
        mujoco.mju_negQuat(self._conjugate, self._quat)

    def _give_up_rest(self) -> None:
        """Command the pose that was reached."""
        self._goal_m[:] = self._position_m
        self._goal_conjugate[:] = self._conjugate
