"""Inverse kinematics of arm and gripper: mink's quadratic program, started from closed-form solutions."""

from __future__ import annotations

import math

import daqp
import mink
import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.robots.registry import Robot
from simpick.geometry.transforms import invert, quaternion_from_matrix, rotation_angle

POSITION_TOLERANCE_M = 1e-4
"""A solution's TCP is at most this far from the commanded one."""
ROTATION_TOLERANCE_RAD = np.deg2rad(0.05)
"""Largest rotation between a solution's TCP and the commanded one."""

_ITERATIONS = 20
_DAMPING = 1e-6
_TCP = "tcp"


class Kinematics:
    """Forward and inverse kinematics of the TCP, on a model of the arm alone.

    A model without parts, gripper joints and bin keeps each of mink's iterations at a fraction of a millisecond,
    for any scene.
    """

    def __init__(self, robot: Robot, T_flange_tcp: Float[np.ndarray, "4 4"]) -> None:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        flange = robot.add(spec)
        T_body_tcp = np.eye(4)
        mujoco.mju_quat2Mat(rotation := np.zeros(9), np.array(flange.quat))
        T_body_tcp[:3, :3] = rotation.reshape(3, 3)
        T_body_tcp[:3, 3] = flange.pos
        T_body_tcp = T_body_tcp @ T_flange_tcp
        flange.parent.add_site(name=_TCP, pos=T_body_tcp[:3, 3], quat=quaternion_from_matrix(T_body_tcp[:3, :3]))
        # Poses of geoms would take half of the time. A body that states its inertia does not need them.
        for geom in list(spec.geoms):
            if geom.parent.explicitinertial:
                spec.delete(geom)
        self.model = spec.compile()
        self.tcp_site = _TCP
        """Name of the TCP's site in `model`."""
        self._T_tcp_flange = invert(T_flange_tcp)
        self._inverse = robot.inverse
        self._configuration = mink.Configuration(self.model)
        self._task = mink.FrameTask(_TCP, "site", position_cost=1.0, orientation_cost=1.0, lm_damping=1e-4)
        self._limit = mink.ConfigurationLimit(self.model)
        eye = np.eye(self.model.nv)
        self._G = np.concatenate([eye, -eye])
        self._no_lower = np.full(len(self._G), -1e30)
        self.q_lower, self.q_upper = self.model.jnt_range[:, 0].copy(), self.model.jnt_range[:, 1].copy()

    def forward(self, q: Float[np.ndarray, "joints"]) -> Float[np.ndarray, "4 4"]:
        """Return T_world_tcp at joint angles `q`."""
        self._configuration.update(q)
        return self._configuration.get_transform_frame_to_world(_TCP, "site").as_matrix()

    def solve_ik(
        self, T_world_tcp: Float[np.ndarray, "4 4"], q_seed: Float[np.ndarray, "joints"]
    ) -> Float[np.ndarray, "joints"] | None:
        """Return the joint angles nearest to `q_seed` that reach the pose, or None if none do."""
        solutions = self.solve_all(T_world_tcp, q_seed)
        return solutions[0] if solutions else None

    def solve_all(
        self,
        T_world_tcp: Float[np.ndarray, "4 4"],
        q_seed: Float[np.ndarray, "joints"],
        known: dict[bytes, Float[np.ndarray, "joints"] | None] | None = None,
    ) -> list[Float[np.ndarray, "joints"]]:
        """Return every branch of solutions, the one that needs the least motion of any joint from `q_seed` first.

        For a pose that is asked again and again, `known` keeps where the solver ended from each closed-form solution:
        a dict of this pose and this object alone, empty at first.
        """
        seeds = self._inverse(T_world_tcp @ self._T_tcp_flange, q_seed)
        target = mink.SE3.from_matrix(T_world_tcp)
        nearest_first = seeds[np.argsort(np.abs(seeds - q_seed).max(axis=1), kind="stable")]
        inside = nearest_first - 2 * np.pi * (nearest_first > self.q_upper) + 2 * np.pi * (nearest_first < self.q_lower)
        known = {} if known is None else known
        for seed in inside:
            if seed.tobytes() not in known:
                known[seed.tobytes()] = self._converge(target, seed)
        solutions = [q.copy() for seed in inside if (q := known[seed.tobytes()]) is not None]
        if not solutions:
            return []
        order = np.argsort(np.abs(np.array(solutions) - q_seed).max(axis=1), kind="stable")
        return [solutions[k] for k in order]

    def converge(
        self, T_world_tcp: Float[np.ndarray, "4 4"], q_start: Float[np.ndarray, "joints"]
    ) -> Float[np.ndarray, "joints"] | None:
        """Return where mink's solver ends from `q_start` if that is within tolerance of the pose, else None.

        From a start nearby it stays on the same branch, which is what following a line needs.
        """
        return self._converge(mink.SE3.from_matrix(T_world_tcp), q_start)

    def _converge(self, target: mink.SE3, q_start: Float[np.ndarray, "joints"]) -> Float[np.ndarray, "joints"] | None:
        configuration = self._configuration
        configuration.update(q_start.clip(self.q_lower, self.q_upper))
        self._task.set_target(target)
        for _ in range(_ITERATIONS):
            error = self._task.compute_error(configuration)
            position_m, rotation_rad = math.sqrt(error[:3].dot(error[:3])), math.sqrt(error[3:].dot(error[3:]))
            if position_m < POSITION_TOLERANCE_M and rotation_rad < ROTATION_TOLERANCE_RAD:
                return configuration.q
            step = self._step(error)
            if step is None:
                return None
            configuration.update(configuration.q + step)
        return None

    def _step(self, error: Float[np.ndarray, "6"]) -> Float[np.ndarray, "joints"] | None:
        """Return what `mink.solve_ik` does with task and limits, to the last bit, in less than half of its time.

        mink assembles the program from any tasks and limits, and qpsolvers checks it; here both are always the same.
        None where the program has no solution.
        """
        task, limit, q = self._task, self._limit, self._configuration.q
        W, weighted_error = task.compute_jacobian(self._configuration), -error
        H = W.T @ W
        H.flat[:: len(q) + 1] += _DAMPING + task.lm_damping * float(weighted_error @ weighted_error)
        bounds = np.concatenate([limit.upper - q, q - limit.lower])
        bounds *= limit.gain
        step, _, status, _ = daqp.solve(
            H, -(weighted_error @ W), self._G, bounds, self._no_lower, np.zeros(len(bounds), np.intc)
        )
        return step if status > 0 else None

    def follow(
        self, Ts_world_tcp: Float[np.ndarray, "points 4 4"], q_start: Float[np.ndarray, "joints"]
    ) -> Float[np.ndarray, "points joints"] | None:
        """Return joint angles along a path of TCP poses without a jump, or None where it leaves the arm's reach."""
        q, qs = q_start, []
        for T_world_tcp in Ts_world_tcp:
            following = self.converge(T_world_tcp, q)
            # Neighbouring poses are millimetres apart: a large step is a change of branch at a singularity.
            if following is None or np.abs(following - q).max() > 0.6:
                return None
            q = following
            qs.append(q)
        return np.array(qs)


def line(
    T_world_start: Float[np.ndarray, "4 4"], T_world_end: Float[np.ndarray, "4 4"], spacing_m: float = 0.015
) -> Float[np.ndarray, "points 4 4"]:
    """Return TCP poses from start to end (both included) on a straight line with the end's constant orientation.

    Raises ValueError where the orientations differ: such a path is not a line of the tool.
    """
    if rotation_angle(T_world_start[:3, :3].T @ T_world_end[:3, :3]) > 1e-6:
        raise ValueError("a straight line must keep its orientation; turn the tool before or after it")
    distance = float(np.linalg.norm(T_world_end[:3, 3] - T_world_start[:3, 3]))
    points = max(2, int(np.ceil(distance / spacing_m)) + 1)
    Ts = np.repeat(T_world_end[None], points, axis=0)
    Ts[:, :3, 3] = np.linspace(T_world_start[:3, 3], T_world_end[:3, 3], points)
    return Ts
