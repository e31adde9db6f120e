"""Plans from a grasp pose to the arm's motion: equivalent orientation, arm posture and path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from simpick.assets.grippers import Gripper, get_gripper
from simpick.assets.grippers.sampling.selection import turn_about_z
from simpick.assets.robots.registry import Robot, get_robot
from simpick.errors import ConfigError
from simpick.geometry.transforms import transform
from simpick.motion.collision import CellCollision
from simpick.motion.config import MotionConfig
from simpick.motion.kinematics import Kinematics, line
from simpick.motion.trajectory import JointSegment, PathTrajectory
from simpick.scene.config import SceneConfig
from simpick.scene.workspace import CHUTE_CENTRE_M

_FREE_TURNS = 8
_DROP_YAWS = 8
_TOOL_DOWN = np.diag([1.0, -1.0, -1.0])
_LIFT_TRIES = 4
_PROBE_FRACTION = 0.015


@dataclass(frozen=True, eq=False)
class PickPlan:
    """The motion to a grasp; what follows is planned from the arm's configuration at that time."""

    T_world_grasp: Float[np.ndarray, "4 4"]
    """The chosen one of the equivalent TCP poses."""
    approach: JointSegment
    """From home to over the bin."""
    descent: PathTrajectory
    """Straight down, then along the tool's axis to the grasp; to just before it where the gripper is pressed on."""
    probe: PathTrajectory | None
    """For a gripper that is pressed on: slowly along the tool's axis, past the grasp, until it holds a part."""


@dataclass(frozen=True)
class NoPlan:
    """Why there is no motion to a grasp."""

    cause: str


class PickPlanner:
    """Plans in one cell: robot, gripper, bin and chute; without its parts."""

    def __init__(self, config: SceneConfig, motion: MotionConfig) -> None:
        if config.robot is None:
            raise ConfigError("robot must be the name of an arm to plan motions, got None; set SceneConfig.robot")
        self.motion = motion
        self.robot: Robot = get_robot(config.robot)
        self.gripper: Gripper = get_gripper(config.gripper)
        self.kinematics = Kinematics(self.robot, self.gripper.T_base_tcp)
        self.collision = CellCollision(config, self.robot)
        over_chute = np.array([CHUTE_CENTRE_M[0], CHUTE_CENTRE_M[1], CHUTE_CENTRE_M[2] + motion.release_height_m])
        turns = [turn_about_z(2 * np.pi * k / _DROP_YAWS)[:3, :3] for k in range(_DROP_YAWS)]
        self._drops: list[tuple[Float[np.ndarray, "4 4"], dict[bytes, Float[np.ndarray, "joints"] | None]]] = [
            (transform(R @ _TOOL_DOWN, over_chute), {}) for R in turns
        ]
        """Poses of the TCP over the chute, and the joint angles that are known to reach each."""

    def plan(self, T_world_tcp: Float[np.ndarray, "4 4"], opening_m: float) -> PickPlan | NoPlan:
        """Return the fastest motion from home to the TCP pose with the gripper opened to `opening_m`.

        Orientations that make the same grasp compete: both of a jaw's, eight turns of a suction head about its axis.
        """
        home = self.robot.home_qpos
        turns = self.gripper.turn_symmetry or _FREE_TURNS
        choices = []
        for k in range(turns):
            T_world_grasp = T_world_tcp @ turn_about_z(2 * np.pi * k / turns)
            choices += [(T_world_grasp, q) for q in self.kinematics.solve_all(T_world_grasp, home)]
        if not choices:
            x, y, z = 1000 * T_world_tcp[:3, 3]
            return NoPlan(f"no joint angles bring the TCP to ({x:.0f}, {y:.0f}, {z:.0f}) mm with this orientation")
        choices.sort(key=lambda choice: float(np.abs(choice[1] - home).max()))
        self.collision.set_opening(opening_m)
        causes: list[str] = []
        for T_world_grasp, q_grasp in choices:
            plan = self._plan_branch(T_world_grasp, q_grasp)
            if isinstance(plan, PickPlan):
                return plan
            causes.append(plan.cause)
        # All branches fail for the same reason, or the first, most natural one gives the most useful cause.
        return NoPlan(causes[0])

    def _plan_branch(
        self, T_world_grasp: Float[np.ndarray, "4 4"], q_grasp: Float[np.ndarray, "joints"]
    ) -> PickPlan | NoPlan:
        motion, kinematics = self.motion, self.kinematics
        found = self.collision.contact(q_grasp)
        if found is not None:
            return NoPlan(f"at the grasp, {found}")

        # Traced from the grasp outwards: the approach is the retreat reversed, on the same branch.
        T_world_end, probe = T_world_grasp, None
        if self.gripper.press_m > 0:
            T_world_end = _shifted(T_world_grasp, -0.004)
            T_world_deepest = _shifted(T_world_grasp, self.gripper.press_m + motion.search_m)
            probing = line(T_world_end, T_world_deepest, spacing_m=0.004)
            q_probe = kinematics.follow(probing, q_grasp)
            if q_probe is None:
                return NoPlan("the arm cannot press the suction face along its axis from there")
            probe = self.trajectory(q_probe, probing, _PROBE_FRACTION)
            q_grasp = q_probe[0]
        T_world_pre = _shifted(T_world_end, -motion.approach_m)
        T_world_hover = T_world_pre.copy()
        T_world_hover[2, 3] = max(T_world_pre[2, 3], motion.hover_height_m)
        Ts = line(T_world_end, T_world_pre)
        if T_world_hover[2, 3] - T_world_pre[2, 3] > 1e-3:
            Ts = np.concatenate([Ts, line(T_world_pre, T_world_hover)[1:]])
        qs = kinematics.follow(Ts, q_grasp)
        if qs is None:
            return NoPlan("the straight way down to the grasp leaves the arm's reach")
        found = self.collision.path_contact(qs)
        if found is not None:
            return NoPlan(f"on the way down, {found}")
        home = self.robot.home_qpos
        found = self.collision.path_contact(np.stack([home, qs[-1]]))
        if found is not None:
            return NoPlan(f"on the way to the bin, {found}")
        descent = self.trajectory(qs[::-1], Ts[::-1], 1.0)
        return PickPlan(T_world_grasp, self.segment(home, qs[-1]), descent, probe)

    def lift(
        self, q: Float[np.ndarray, "joints"], height_m: float | None = None, fraction: float = 1.0
    ) -> PathTrajectory | None:
        """Return the straight lift from joint angles `q` to `height_m`, or as high as the arm reaches.

        None where the TCP is up there already or the arm cannot rise at all.
        """
        height = self.motion.lift_height_m if height_m is None else height_m
        T_world_start = self.kinematics.forward(q)
        rise = height - T_world_start[2, 3]
        for share in np.linspace(1.0, 0.25, _LIFT_TRIES):
            if rise * share < 2e-3:
                return None
            T_world_end = T_world_start.copy()
            T_world_end[2, 3] += rise * share
            Ts = line(T_world_start, T_world_end)
            qs = self.kinematics.follow(Ts, q)
            if qs is not None:
                return self.trajectory(qs, Ts, fraction)
        return None

    def drop_pose(self, q: Float[np.ndarray, "joints"]) -> Float[np.ndarray, "joints"]:
        """Return the joint angles over the chute, tool down, for the fastest motion there from `q` and then home.

        Collision-free motions come first. Raises ConfigError where the arm does not reach that pose.
        """
        home = self.robot.home_qpos
        solutions = [s for T_world_tcp, known in self._drops for s in self.kinematics.solve_all(T_world_tcp, q, known)]
        if not solutions:
            raise ConfigError(
                f"motion release_height_m must be a height over the chute that the arm reaches, got"
                f" {self.motion.release_height_m}; the default is {MotionConfig().release_height_m}"
            )
        solutions.sort(key=lambda s: float(np.abs(s - q).max() + np.abs(s - home).max()))
        for solution in solutions:
            if self.collision.path_contact(np.stack([q, solution, home])) is None:
                return solution
        return solutions[0]

    def segment(
        self, q_start: Float[np.ndarray, "joints"], q_end: Float[np.ndarray, "joints"], fraction: float = 1.0
    ) -> JointSegment:
        """Return the joint-space move at `fraction` of full acceleration and its square root of full speed."""
        motion, pace = self.motion, float(np.sqrt(fraction))
        return JointSegment.within(
            q_start, q_end, motion.joint_speed_rad_s * pace, motion.joint_acceleration_rad_s2 * fraction
        )

    def trajectory(
        self, qs: Float[np.ndarray, "points joints"], Ts_world_tcp: Float[np.ndarray, "points 4 4"], fraction: float
    ) -> PathTrajectory:
        """Return the pass through a traced path at `fraction` of full acceleration and its root of full speed."""
        steps = np.linalg.norm(np.diff(Ts_world_tcp[:, :3, 3], axis=0), axis=1)
        motion, pace = self.motion, float(np.sqrt(fraction))
        return PathTrajectory.within(
            qs,
            np.concatenate([[0.0], np.cumsum(steps)]),
            motion.joint_speed_rad_s * pace,
            motion.joint_acceleration_rad_s2 * fraction,
            motion.tcp_speed_m_s * pace,
        )


def _shifted(T_world_tcp: Float[np.ndarray, "4 4"], distance_m: float) -> Float[np.ndarray, "4 4"]:
    """Return the pose moved along the tool's own z axis."""
    return T_world_tcp @ transform(translation=np.array([0.0, 0.0, distance_m]))
