"""Verification: every grasp is tested in a small simulation before it is used.

The gripper is fixed in space with its approach pointing down and grips the floating part; then it is lifted, shaken
and tilted. It stands still while gravity moves: by d'Alembert's principle a part in an accelerating or tilting hand
experiences exactly this, and a hand that does not move needs no controller. Solver and time step are the scene's, and
so are the contacts that hold, because pads and cells have priority over a part's own settings.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.grippers import Gripper, get_gripper
from simpick.assets.mjcf import add_part
from simpick.assets.part import Part
from simpick.geometry.transforms import (
    invert,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_angle,
    so3_exp,
    transform,
)
from simpick.records import Grasp
from simpick.scene.physics import PhysicsConfig, apply_physics
from simpick.threads import usable_cores

_GRAVITY = 9.81
_MOST_THREADS = 4
"""More would wait for Python's lock, which a trial holds for a quarter of its time."""


class GraspBench:
    """A floating gripper and one part; `holds` runs one grasp."""

    def __init__(self, part: Part, gripper: str) -> None:
        self.part = part
        self.gripper = get_gripper(gripper)
        self.config = self.gripper.hold_test
        spec = mujoco.MjSpec()
        apply_physics(spec, PhysicsConfig(sleep=False))
        mount = spec.worldbody.add_body(name="mount", quat=[0.0, 1.0, 0.0, 0.0])
        self.gripper.add(spec, mount)
        add_part(spec, part, "part")
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        site = self.data.site(self.gripper.tcp_site)
        self._T_world_tcp = transform(site.xmat.reshape(3, 3), site.xpos)
        joint = self.model.joint("part")
        self._qpos, self._dof = int(joint.qposadr[0]), int(joint.dofadr[0])
        self._body = self.model.body("part").id
        self._com = np.asarray(part.solid.center_mass)

    def holds(self, grasp: Grasp) -> float:
        """Return 0 where the part is lost or moves too far in the hand, else how still it stays, in (0, 1]."""
        if not self._grip(grasp):
            return 0.0
        before = self._T_tcp_part()
        for step, gravity in enumerate(self._gravity_program()):
            self.model.opt.gravity[:] = gravity
            mujoco.mj_step(self.model, self.data)
            if step % 10 == 9:
                self.gripper.maintain(self.model, self.data)
            # Checking several times per second ends failed trials early.
            if step % 40 == 39 and self._moved(before)[0] > self.config.slip_limit_m:
                return 0.0
        slip, turn = self._moved(before)
        limit_m, limit_rad = self.config.slip_limit_m, np.radians(self.config.turn_limit_deg)
        if self._body not in self.gripper.held_bodies(self.model, self.data) or slip > limit_m or turn > limit_rad:
            return 0.0
        return float(1.0 - 0.5 * (slip / limit_m + turn / limit_rad))

    def _grip(self, grasp: Grasp) -> bool:
        """Place the part, grip it without gravity, and return whether it is held about where it was."""
        model, data, config = self.model, self.data, self.config
        mujoco.mj_resetData(model, data)
        model.opt.gravity[:] = 0.0
        self.gripper.reset(model, data, min(grasp.width_m + 0.006, self.gripper.max_opening_m))
        T_world_part = self._T_world_tcp @ invert(grasp.T_part_tcp)
        data.qpos[self._qpos : self._qpos + 3] = T_world_part[:3, 3]
        data.qpos[self._qpos + 3 : self._qpos + 7] = quaternion_from_matrix(T_world_part[:3, :3])
        mujoco.mj_forward(model, data)
        if any(contact.dist < -0.0015 for contact in data.contact[: data.ncon]):
            return False
        start = self._T_tcp_part()
        for step in range(int(config.close_s / model.opt.timestep)):
            if step % 10 == 0:
                self.gripper.grip(model, data)
            mujoco.mj_step(model, data)
            resting = np.abs(data.qvel[self._dof : self._dof + 3]).max() < 1e-3
            if step % 10 == 9 and step > 40 and resting and self._held():
                break
        moved_m, moved_rad = self._moved(start)
        fine = moved_m < config.settle_limit_m and moved_rad < np.radians(config.settle_limit_deg)
        return fine and self._held()

    def _held(self) -> bool:
        return self._body in self.gripper.held_bodies(self.model, self.data)

    def _gravity_program(self) -> Float[np.ndarray, "steps 3"]:
        """Return gravity over the trial in the hand's frame: lift, shake along x and y, tilt about both, rest."""
        config, dt = self.config, self.model.opt.timestep

        def steps(seconds: float) -> Float[np.ndarray, "n"]:
            return np.arange(int(seconds / dt)) / max(1, int(seconds / dt))

        down = np.array([0.0, 0.0, -_GRAVITY])
        lift = np.tile(down * (1 + config.lift_g), (len(steps(config.lift_s)), 1))
        phases = [lift]
        for axis in (0, 1):
            t = steps(config.shake_s / 2)
            wave = np.tile(down, (len(t), 1))
            wave[:, axis] += config.shake_g * _GRAVITY * np.sin(2 * np.pi * config.shake_hz * t * config.shake_s / 2)
            phases.append(wave)
        for axis in (0, 1):
            # The third power starts and ends without a jerk.
            angle = np.radians(config.tilt_deg) * np.sin(2 * np.pi * steps(config.tilt_s / 2)) ** 3
            tilted = np.zeros((len(angle), 3))
            tilted[:, axis], tilted[:, 2] = -_GRAVITY * np.sin(angle), -_GRAVITY * np.cos(angle)
            phases.append(tilted)
        return np.concatenate([*phases, np.tile(down, (int(0.04 / dt), 1))])

    def _T_tcp_part(self) -> Float[np.ndarray, "4 4"]:
        pose = self.data.qpos[self._qpos : self._qpos + 7]
        return invert(self._T_world_tcp) @ transform(matrix_from_quaternion(pose[3:]), pose[:3])

    def _moved(self, T_tcp_before: Float[np.ndarray, "4 4"]) -> tuple[float, float]:
        """Return how far the centre of mass has moved (m) and the part has turned (rad) in the hand."""
        now = self._T_tcp_part()
        here = now[:3, :3] @ self._com + now[:3, 3]
        there = T_tcp_before[:3, :3] @ self._com + T_tcp_before[:3, 3]
        turn = rotation_angle(now[:3, :3] @ T_tcp_before[:3, :3].T)
        return float(np.linalg.norm(here - there)), float(turn)


def verified(
    part: Part,
    grasps: Sequence[Grasp],
    gripper: str,
    *,
    enough: int | None = None,
    on_share: Callable[[float], None] | None = None,
) -> list[Grasp]:
    """Return the grasps that hold, best first; quality = sampled quality x stillness, less where an offset loses it.

    They are tried in the given order until `enough` hold. Deterministic. A grasp that holds as planned but not when
    displaced by the config's disturbance keeps half of its quality: it is a last resort for a pose estimate that is
    never exact. `on_share` is called with the share of the work that is done after each grasp.
    """
    if not grasps:
        return []
    # MuJoCo steps without Python's lock, so that threads share the trials: two take 0.77 of the time of one (jaw).
    own = threading.local()

    def tried(number: int, grasp: Grasp) -> Grasp | None:
        if not hasattr(own, "bench"):
            own.bench = GraspBench(part, gripper)
        return _tried(own.bench, number, grasp)

    kept = list[Grasp]()
    with ThreadPoolExecutor(min(_MOST_THREADS, usable_cores())) as pool:
        for number, grasp in enumerate(pool.map(tried, range(len(grasps)), grasps), 1):
            kept += [] if grasp is None else [grasp]
            if on_share is not None:
                on_share(max(number / len(grasps), len(kept) / (enough or len(grasps))))
            if len(kept) == enough:
                break
        pool.shutdown(cancel_futures=True)
    return sorted(kept, key=lambda g: -g.quality)


def _tried(bench: GraspBench, number: int, grasp: Grasp) -> Grasp | None:
    """Return the grasp with its quality, None if it does not hold."""
    still = bench.holds(grasp)
    if still == 0.0:
        return None
    sturdy = bench.holds(_disturbed(grasp, bench.gripper, np.random.default_rng(number)))
    factor = 0.5 + 0.25 * still + 0.25 * sturdy if sturdy > 0 else 0.5 * still
    return replace(grasp, quality=float(grasp.quality * factor))


def _disturbed(grasp: Grasp, gripper: Gripper, rng: np.random.Generator) -> Grasp:
    """Return the grasp as an inexact pose estimate would place it."""
    test = gripper.hold_test
    axis = rng.normal(size=3)
    offset = rng.normal(size=3)
    if gripper.press_m > 0:
        # A head that is pressed on takes up an error along the approach, but none across it.
        offset[2] = 0.0
    rotation = so3_exp(np.radians(test.disturbance_deg) * axis / np.linalg.norm(axis))
    shift = test.disturbance_m * offset / np.linalg.norm(offset)
    width = grasp.width_m + (2 * test.disturbance_m if gripper.max_opening_m > 0 else 0.0)
    return Grasp(grasp.T_part_tcp @ transform(rotation, shift), width, grasp.quality)
