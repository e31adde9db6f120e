"""`PickExecutor`: carries out one pick in the simulator and reports what happened, and why.

Home, over the bin, down, grip, lift, over the chute, release, home. The arm is blind: it moves where it is commanded,
senses forces and lags, and stops where it is blocked. The parts' fate is read from the simulation afterwards.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from simpick.errors import ConfigError, SimulationFaultError
from simpick.geometry import rotation_angle
from simpick.motion.config import MotionConfig
from simpick.motion.monitor import Monitor, Obstruction
from simpick.motion.planner import NoPlan, PickPlan, PickPlanner
from simpick.motion.trajectory import Trajectory, period_ends
from simpick.motion.verdict import Evidence, judge
from simpick.records import PickOutcome, PickResult
from simpick.scene import Scene
from simpick.scene.robot import ARM_PREFIX

_GRIP_MIN_S, _GRIP_MAX_S = 0.10, 0.60
_OPENING_STILL_M = 5e-5
_RELEASE_S = 0.20
_REST_S = 0.04
_SHED_S = 0.25
_STILL_SPEED = 0.01
_STILL_TICKS = 5
_SEATED_TICKS = 3


class PickExecutor:
    """Picks repeatedly in one scene; the arm starts and ends every pick at home."""

    def __init__(
        self,
        scene: Scene,
        on_step: Callable[[Scene], None] | None = None,
        config: MotionConfig | None = None,
        on_stage: Callable[[str], None] | None = None,
    ) -> None:
        """Take over the arm of `scene`.

        `on_step` is called with the scene after every control period (10 ms), `on_stage` with the name of each stage
        as it begins.
        """
        if scene.robot is None or scene.gripper is None:
            raise ConfigError("robot must be the name of an arm to pick, got None; set SceneConfig.robot")
        self.scene = scene
        self.config = config or MotionConfig()
        self.on_step = on_step
        self.on_stage = on_stage
        self.on_look: Callable[[Float[np.ndarray, "4 4"]], Float[np.ndarray, "4 4"] | None] | None = None
        """Called over the bin, before the descent, with the target TCP pose; a returned pose replaces it if it is near
        and within reach. The arm rests there in any case, and the wrist camera sees the whole part between the
        fingers; lower down the gripper begins to occlude it."""
        self.planner = PickPlanner(scene.config, self.config)
        self._gripper = scene.gripper
        model = scene.model
        names = [ARM_PREFIX + name for name in scene.robot.joint_names]
        self._adr = np.array([model.joint(name).qposadr[0] for name in names])
        self._actuators = np.array([model.actuator(name).id for name in names])
        self._servo_command = scene.robot.servo_command
        self._steps = max(1, round(self.config.control_period_s / model.opt.timestep))
        self._period_s = self._steps * float(model.opt.timestep)
        self._q = scene.robot.home_qpos.copy()
        self._evidence = Evidence(in_bin=(), in_chute=())
        self._monitor = Monitor(scene, self.config)

    @property
    def stage(self) -> str:
        """Return the stage of the present pick, or the last stage of the previous one; for `on_step`."""
        return self._evidence.stages[-1] if self._evidence.stages else "home"

    # -- the pick -----------------------------------------------------------------------------------------------

    def execute(self, T_world_tcp: Float[np.ndarray, "4 4"], opening_m: float) -> PickResult:
        """Pick with the TCP at `T_world_tcp` and the gripper opened to `opening_m` beforehand.

        Parts that reach the chute, or that stay stuck on the gripper, are removed from the scene. Never raises for
        what happens in the simulation: a diverged one ends as `PickOutcome.SIMULATION_FAULT`.
        """
        scene = self.scene
        self._evidence = Evidence(in_bin=scene.parts_in_bin(), in_chute=scene.parts_in_chute())
        self._monitor = Monitor(scene, self.config)
        start_s, motion_s = scene.time_s, 0.0
        try:
            plan = self.planner.plan(T_world_tcp, opening_m)
            if isinstance(plan, NoPlan):
                self._evidence.unreachable = plan.cause
            else:
                self._q = scene.data.qpos[self._adr].copy()
                self._pick(plan, opening_m)
                motion_s = scene.time_s - start_s
                self._settle()
                self._evidence.stuck = tuple(k for k in self._monitor.clinging() if not scene.in_bin(k))
            self._evidence.in_bin_after = scene.parts_in_bin()
            self._evidence.in_chute_after = scene.parts_in_chute()
        except SimulationFaultError as error:
            self._evidence.fault = str(error)
            motion_s = scene.time_s - start_s
        verdict = judge(self._evidence)
        if verdict.outcome is not PickOutcome.SIMULATION_FAULT:
            # What still sticks to the gripper at home would spoil every later pick: an operator takes it off.
            for instance in (*verdict.delivered, *self._evidence.stuck):
                scene.remove(instance)
        return PickResult(
            outcome=verdict.outcome,
            cause=verdict.cause,
            stages=tuple(self._evidence.stages),
            motion_s=motion_s,
            peak_force_n=self._monitor.peak_force_n,
            delivered=verdict.delivered,
            ejected=verdict.ejected,
            gripped=self._evidence.gripped,
        )

    def _pick(self, plan: PickPlan, opening_m: float) -> None:
        scene, evidence = self.scene, self._evidence
        self._gripper.release(scene.model, scene.data, opening_m)
        home = self.planner.robot.home_qpos
        self._stage("approach")
        blocked = self._run(self.planner.segment(self._q, home)) if np.abs(self._q - home).max() > 1e-3 else None
        blocked = blocked or self._run(plan.approach)
        if blocked is None and self.on_look is not None:
            self._stage("look")
            plan = self._looked_again(plan, opening_m)
        if blocked is None:
            self._stage("descend")
            blocked = self._run(plan.descent)
        if blocked is None or self._near(plan):
            self._stage("grip")
            blocked = self._grip(plan, blocked)
        if blocked is not None:
            evidence.collision = f"at stage {evidence.stages[-1]}, {blocked.cause}"
        evidence.gripped = self._monitor.held()
        if not evidence.gripped and evidence.collision is None:
            evidence.nothing_gripped = self._gripper.empty_cause(self.scene.model, self.scene.data)
        if evidence.gripped:
            self._deliver()
        else:
            self._return_empty(opening_m)

    def _looked_again(self, plan: PickPlan, opening_m: float) -> PickPlan:
        """Return the plan to the corrected grasp, with the arm moved over it; the old one where that does not do."""
        assert self.on_look is not None
        T_world_tcp = self.on_look(plan.T_world_grasp.copy())
        if T_world_tcp is None or not self._near_enough(plan.T_world_grasp, T_world_tcp):
            return plan
        corrected = self.planner.plan(T_world_tcp, opening_m)
        if isinstance(corrected, NoPlan):
            return plan
        q_above = corrected.descent.states([0.0])[0][0]
        if self.planner.collision.path_contact(np.stack([self._q, q_above])) is not None:
            return plan
        if np.abs(self._q - q_above).max() > 1e-6 and self._run(self.planner.segment(self._q, q_above)) is not None:
            return plan
        return corrected

    def _near_enough(self, T_world_old: Float[np.ndarray, "4 4"], T_world_new: Float[np.ndarray, "4 4"]) -> bool:
        """Return whether a correction stays within the limits of the configuration."""
        moved_m = float(np.linalg.norm(T_world_new[:3, 3] - T_world_old[:3, 3]))
        turned_rad = float(rotation_angle(T_world_old[:3, :3].T @ T_world_new[:3, :3]))
        return bool(moved_m <= self.config.look_limit_m and turned_rad <= self.config.look_limit_rad)

    def _deliver(self) -> None:
        evidence = self._evidence
        self._stage("lift")
        fraction = self._gripper.loaded_acceleration
        lift = self.planner.lift(self._q, fraction=fraction)
        blocked = self._run(lift, carrying=True) if lift is not None else None
        if blocked is not None:
            evidence.collision = f"at stage lift, {blocked.cause}"
            self._return_empty(self._gripper.max_opening_m)
            return
        evidence.lifted = tuple(k for k in evidence.in_bin if not self.scene.in_bin(k))
        if evidence.lost_at is not None:
            self._return_empty(self._gripper.max_opening_m)
            return
        self._stage("carry")
        q_drop = self.planner.drop_pose(self._q)
        blocked = self._run(self.planner.segment(self._q, q_drop, fraction), carrying=True)
        if blocked is not None:
            evidence.collision = f"at stage carry, {blocked.cause}"
        self._stage("release")
        self._gripper.release(self.scene.model, self.scene.data, self._gripper.max_opening_m)
        self._dwell(_RELEASE_S)
        self._stage("return")
        self._run(self.planner.segment(self._q, self.planner.robot.home_qpos), watch=False)
        self._dwell(_REST_S)

    def _return_empty(self, opening_m: float) -> None:
        """Release anything between the fingers, move straight up, and home."""
        self._stage("retract")
        self._gripper.release(self.scene.model, self.scene.data, opening_m)
        lift = self.planner.lift(self._q, height_m=self.config.hover_height_m)
        if lift is not None:
            self._run(lift, watch=False)
        if self._monitor.clinging():
            self._shed()
        self._stage("return")
        self._run(self.planner.segment(self._q, self.planner.robot.home_qpos), watch=False)
        self._dwell(_REST_S)

    def _shed(self) -> None:
        """Open, close and open over the bin: a part may sit between the fingers, or on one of them by a hole."""
        model, data = self.scene.model, self.scene.data
        for opening in (self._gripper.max_opening_m, 0.0, self._gripper.max_opening_m):
            self._gripper.release(model, data, opening)
            self._dwell(_SHED_S)
            if not self._monitor.clinging():
                return

    # -- gripping -----------------------------------------------------------------------------------------------

    def _grip(self, plan: PickPlan, blocked: Obstruction | None) -> Obstruction | None:
        model, data = self.scene.model, self.scene.data
        if plan.probe is not None:
            return self._probe(plan.probe) if blocked is None else blocked
        self._gripper.grip(model, data)
        elapsed, before, seated = 0.0, self._gripper.opening_m(model, data), 0
        while elapsed < _GRIP_MAX_S and (elapsed < _GRIP_MIN_S or seated < _SEATED_TICKS):
            self._tick(self._q, np.zeros_like(self._q))
            elapsed += self._period_s
            opening = self._gripper.opening_m(model, data)
            seated = seated + 1 if abs(opening - before) < _OPENING_STILL_M else 0
            before = opening
        return None

    def _probe(self, probe: Trajectory) -> Obstruction | None:
        """Go on slowly until the suction face holds a part, then stop; to find none is no obstruction."""
        model, data = self.scene.model, self.scene.data
        seated = 0
        for q, qd in zip(*probe.states(period_ends(probe.duration_s, self._period_s)), strict=True):
            self._tick(q, qd)
            blocked = self._monitor.obstruction(data.qpos[self._adr], q, holding=False)
            if blocked is not None:
                self._halt()
                return blocked
            if seated == 0 and self._monitor.part_force_n > 0:
                self._gripper.grip(model, data)
            seated = seated + 1 if self._monitor.held() else 0
            if seated == _SEATED_TICKS:
                break
        self._dwell(0.05)
        return None

    def _near(self, plan: PickPlan) -> bool:
        """Return whether the TCP stands close enough to the grasp to try it although the approach was blocked."""
        T_world_tcp = self.planner.kinematics.forward(self._q)
        return float(np.linalg.norm(T_world_tcp[:3, 3] - plan.T_world_grasp[:3, 3])) < self.config.near_goal_m

    # -- moving -------------------------------------------------------------------------------------------------

    def _run(self, trajectory: Trajectory, carrying: bool = False, watch: bool = True) -> Obstruction | None:
        """Follow a trajectory to its end, or until something blocks the arm: then stop and return it.

        While `carrying`, a lost part is noted with its place; the motion continues.
        """
        for q, qd in zip(*trajectory.states(period_ends(trajectory.duration_s, self._period_s)), strict=True):
            self._tick(q, qd)
            if watch:
                blocked = self._monitor.obstruction(self.scene.data.qpos[self._adr], q, holding=carrying)
                if blocked is not None:
                    self._halt()
                    return blocked
            evidence = self._evidence
            if carrying and evidence.lost_at is None and self._monitor.lost(evidence.gripped):
                evidence.lost_at = evidence.stages[-1]
                evidence.lost_in_bin = all(self.scene.in_bin(k) for k in evidence.gripped)
                evidence.lost_height_m = float(self.planner.kinematics.forward(q)[2, 3])
        return None

    def _halt(self) -> None:
        """Command the arm to stay where it is."""
        self._q = self.scene.data.qpos[self._adr].copy()
        self._dwell(0.05)

    def _dwell(self, duration_s: float) -> None:
        for _ in range(max(1, round(duration_s / self._period_s))):
            self._tick(self._q, np.zeros_like(self._q))

    def _tick(self, q: np.ndarray, qd: np.ndarray) -> None:
        """Command the servos, simulate one control period, and read the contacts."""
        scene = self.scene
        self._q = q
        scene.data.ctrl[self._actuators] = self._servo_command(q, qd)
        self._gripper.maintain(scene.model, scene.data)
        scene.step(self._steps)
        self._monitor.look()
        if self.on_step is not None:
            self.on_step(scene)

    def _settle(self) -> None:
        """Wait at home until the parts are at rest."""
        still = 0
        for _ in range(round(self.config.settle_s / self._period_s)):
            still = still + 1 if self._monitor.still(_STILL_SPEED) else 0
            if still >= _STILL_TICKS:
                return
            self._tick(self._q, np.zeros_like(self._q))

    def _stage(self, name: str) -> None:
        self._evidence.stages.append(name)
        if self.on_stage is not None:
            self.on_stage(name)
