"""``simpick/BinServo-v0``: one step is one control tick of 50 ms; the action is the TCP's velocity."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import EzPickle
from jaxtyping import Float, Float32

from simpick.envs.bin_env import RENDER_MODES, BinEnv, check_count, part_pool
from simpick.envs.servo_spaces import (
    IMAGES,
    MAX_JOINT_RAD,
    MAX_JOINT_SPEED_RAD_S,
    SERVO_WORKSPACE,
    ServoCommand,
    decode_servo_action,
    servo_action_space,
    servo_observation_space,
    servo_scene_config,
)
from simpick.errors import ConfigError, SimulationFaultError
from simpick.motion import Kinematics, MotionConfig, TwistServo
from simpick.motion.monitor import Monitor
from simpick.rendering.quality import RenderQuality
from simpick.rendering.scene_renderer import SceneRenderer
from simpick.scene import SceneConfig
from simpick.scene.robot import ARM_PREFIX

TICK_HZ = 20
"""Steps of the environment per second of simulated time."""
PERIODS_PER_TICK = 5
"""Joint commands per tick."""
DELIVERY_REWARD = 1.0
"""Per part delivered."""
COLLISION_COST = 0.01
"""Per tick in which arm or gripper pressed on bin, chute or table above `MotionConfig.collision_force_n`."""
FAST_IMAGES = RenderQuality(shadow_map_px=0, samples=0)
"""Without shadows and anti-aliasing: a fifth of the cost on a software renderer."""
_STILL_SPEED_M_S = 0.01
_IDENTITY = np.eye(4, dtype=np.float32)


class BinServoEnv(BinEnv, EzPickle):
    """Steer the arm at 20 Hz, for reinforcement learning, imitation and teleoperation.

    ## Description

    The cell is that of `BinPickEnv`; one step is one control tick of 50 ms. An action is the TCP's velocity and the
    gripper's rate. The velocity changes linearly to the commanded one within the tick. Joint limits, joint speeds and
    the box `SERVO_WORKSPACE` are kept: what cannot be followed is left out. A part that lies in the chute and is
    released counts as delivered and is removed from the scene.

    `render` shows the `overview` camera: ``rgb_array`` the present frame, ``rgb_array_list`` every frame since the last
    call (20 per second of simulated time).

    ## Action Space

    `Box(-1.0, 1.0, (7,), float32)`, velocities in world axes:

    | Num | Action | At -1 | At 1 | Unit |
    |---|---|---|---|---|
    | 0-2 | linear velocity of the TCP along world x, y, z | -0.25 | 0.25 | m/s |
    | 3-5 | angular velocity about world x, y, z through the TCP | -1.5708 | 1.5708 | rad/s |
    | 6 | gripper: > 0 closes or switches the vacuum on, < 0 opens or off, 0 holds | -0.17 | 0.17 | m/s |

    An action of zeros holds arm and gripper.

    ## Observation Space

    `Dict`, with both cameras at their default size and the jaw. With the suction head, ``suction_sealed`` stands in
    place of ``gripper_opening``: 1 while anything is held.

    | Key | Observation | Min | Max | Shape and type | Unit |
    |---|---|---|---|---|---|
    | `overhead` | image from above the bin | 0 | 255 | (120, 160, 3) uint8 | - |
    | `wrist` | image from the camera on the hand | 0 | 255 | (120, 160, 3) uint8 | - |
    | `joint_positions` | of the arm | -6.5 | 6.5 | (6,) float32 | rad |
    | `joint_velocities` | of the arm | -10 | 10 | (6,) float32 | rad/s |
    | `T_world_tcp` | pose of the tool's centre point | -10 | 10 | (4, 4) float32 | m |
    | `gripper_opening` | distance between the pads | 0 | 0.085 | (1,) float32 | m |
    | `remaining` | parts still in the bin | 0 | 50 | () int64 | - |

    ## Information

    `reset` and `step` return ``is_success`` (every part was delivered, none was lost) and ``truth``, arrays with one
    row per instance for evaluation only, NaN once an instance is removed. `step` adds ``delivered``, the instances
    delivered in this tick, ``collision``, and ``ended``, the reason why the episode ended, or "".

    ## Rewards

    +1 per part delivered, -0.01 per tick in which the arm or the gripper collides with bin, chute or table.

    ## Starting State

    `count` parts drawn from `parts` were dropped into the bin and lie still; the arm is at home, the gripper open.
    Everything random about the bin follows from the seed. ``options={"scene_file": path}`` loads a scene saved by
    `Scene.save` instead.

    ## Episode End

    1. Termination: no part is in the bin, in the gripper or in motion (``cleared``).
    2. Termination: the physics diverged (``simulation_fault``).
    3. Truncation: `max_ticks` steps.

    ## Arguments

    | Parameter | Default | Description |
    |---|---|---|
    | `parts` | `()` | names or mesh files that the bin is filled from; the whole library if empty |
    | `count` | `12` | parts in the bin, 1 to 50 |
    | `gripper` | `'jaw'` | name of the gripper: jaw, suction, or one that another package adds |
    | `randomization` | `'default'` | how much looks vary with the seed: default, none or strong |
    | `images` | `('overhead', 'wrist')` | cameras in the observation; without any, nothing is rendered |
    | `image_size` | `(160, 120)` | width and height of the images in pixels |
    | `image_quality` | `FAST_IMAGES` | shadows and anti-aliasing of the images |
    | `max_ticks` | `1200` | steps that end the episode; None for no limit |
    | `scene_config` | `None` | sets every detail instead of `parts`, `count`, `gripper`, looks and image size |
    | `render_mode` | `None` | None, rgb_array or rgb_array_list |

    ## Version History

    * v0: initial version.
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": TICK_HZ}  # noqa: RUF012

    def __init__(
        self,
        parts: Sequence[str] = (),
        count: int = 12,
        gripper: str = "jaw",
        randomization: str = "default",
        images: Sequence[str] = IMAGES,
        image_size: tuple[int, int] = (160, 120),
        image_quality: RenderQuality = FAST_IMAGES,
        max_ticks: int | None = 1200,
        scene_config: SceneConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Make the environment; nothing is simulated before `reset`. See the class for the arguments.

        Raises:
            ConfigError, UnknownPartError, MeshError: the configuration or a part is not valid.
        """
        EzPickle.__init__(
            self,
            parts,
            count,
            gripper,
            randomization,
            images,
            image_size,
            image_quality,
            max_ticks,
            scene_config,
            render_mode,
        )
        named = isinstance(images, (list, tuple)) and all(name in IMAGES for name in images)
        if not named or len(set(images)) != len(images):
            raise ConfigError(f"images must be distinct names out of {', '.join(IMAGES)}, or (), got {images!r}")
        check_count("max_ticks", max_ticks)
        pool = part_pool(parts)
        config = scene_config or servo_scene_config(pool, count, gripper, randomization, image_size)
        super().__init__(config, render_mode)
        self.images = tuple(images)
        self.observation_space = servo_observation_space(self.scene_config, self.images)
        self.action_space = servo_action_space()
        self._image_quality = image_quality
        self._image_renderer: SceneRenderer | None = None
        self._max_ticks = max_ticks
        self._motion = MotionConfig()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Fill a new bin; the arm stands at home with its gripper open. The same `seed` gives the same bin.

        ``options={"scene_file": path}`` loads a scene saved by `Scene.save` instead.

        Raises:
            ConfigError: an option is unknown, or the loaded scene's observations would be others than this
                environment's.
        """
        super().reset(seed=seed)
        start = time.perf_counter()
        scene = self._new_scene(seed, options)
        if servo_observation_space(scene.config, self.images) != self.observation_space or scene.gripper is None:
            self.close()
            raise ConfigError(
                "a loaded scene must have this environment's gripper and image sizes, got others;"
                " make the environment with scene_config=Scene.load(path).config"
            )
        scene.go_home()
        self._gripper = scene.gripper
        self._image_renderer = SceneRenderer(scene, quality=self._image_quality)
        joints = [scene.model.joint(ARM_PREFIX + name) for name in self.robot.joint_names]
        self._qpos_adr = np.array([joint.qposadr[0] for joint in joints])
        self._qvel_adr = np.array([joint.dofadr[0] for joint in joints])
        self._actuators = np.array([scene.model.actuator(ARM_PREFIX + n).id for n in self.robot.joint_names])
        self._tcp = scene.model.site(self._gripper.tcp_site).id
        # A tick is whole simulation steps, as evenly spread over its periods as they go.
        total = max(PERIODS_PER_TICK, round(1.0 / (TICK_HZ * scene.model.opt.timestep)))
        self._steps = np.diff(np.linspace(0, total, PERIODS_PER_TICK + 1).astype(int)).tolist()
        self._periods_s = [steps * float(scene.model.opt.timestep) for steps in self._steps]
        kinematics = Kinematics(self.robot, self._gripper.T_base_tcp)
        self._arm_servo = TwistServo(
            kinematics, self.robot.home_qpos, self._motion.joint_speed_rad_s, SERVO_WORKSPACE, self._periods_s
        )
        self._gripper_servo = self._gripper.servo(scene.model, scene.data)
        self._monitor = Monitor(scene, self._motion)
        self._in_bin = scene.parts_in_bin()
        self._ticks = 0
        self.timings_s = {"simulate": time.perf_counter() - start}
        self._observation = self._observe()
        return self._copy_observation(), self._info()

    def step(self, action: np.ndarray) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Move for one tick as `action` commands and look again.

        Raises:
            ConfigError: the action is not seven finite numbers, or `reset` has not been called.
        """
        scene, command = self.scene, decode_servo_action(action)
        start = time.perf_counter()
        ended, peak_force_n = "", 0.0
        delivered: tuple[int, ...] = ()
        try:
            peak_force_n = self._move(command)
            touched = self._monitor.clinging()
            self._in_bin, in_chute = scene.parts_by_zone()
            delivered = tuple(k for k in in_chute if k not in touched)
            for instance in delivered:
                scene.remove(instance)
            ended = "" if self._work_left() else "cleared"
        except SimulationFaultError:
            self._in_bin, ended = scene.parts_in_bin(), "simulation_fault"
        self.timings_s = {"simulate": time.perf_counter() - start}
        self._ticks += 1
        if ended != "simulation_fault":
            # A diverged state cannot be shown: its episode ends on what was seen last.
            self._observation = self._observe()
        collision = peak_force_n > self._motion.collision_force_n
        reward = DELIVERY_REWARD * len(delivered) - COLLISION_COST * collision
        truncated = not ended and self._max_ticks is not None and self._ticks >= self._max_ticks
        info = self._info() | {
            "delivered": delivered,
            "collision": collision,
            "ended": "max_ticks" if truncated else ended,
        }
        return self._copy_observation(), float(reward), bool(ended), truncated, info

    def _move(self, command: ServoCommand) -> float:
        """Simulate one tick and return the largest force on what never moves."""
        scene, watched = self.scene, self._watched
        data = scene.data
        q, qd = self._arm_servo.commands(command.twist_world, data.qpos[self._qpos_adr])
        controls = self.robot.servo_command(q, qd)
        peak_force_n = 0.0
        for steps, period_s, control in zip(self._steps, self._periods_s, controls, strict=True):
            data.ctrl[self._actuators] = control
            self._gripper_servo.command(command.gripper_rate, period_s)
            scene.advance(steps)
            self._monitor.look()
            peak_force_n = max(peak_force_n, self._monitor.fixed_force_n)
            if watched:
                scene.finish_step()
                self._tick(scene)
        if not watched:
            scene.finish_step()
        return peak_force_n

    def _work_left(self) -> bool:
        """Return whether a part is in the bin, or elsewhere but held, touched or still moving."""
        scene = self.scene
        if self._in_bin:
            return True
        away = np.array([*scene.parts_elsewhere(), *scene.parts_in_chute()], int)
        moving = self._monitor.part_speeds()[away] > _STILL_SPEED_M_S
        return bool(moving.any() or np.isin(away, self._monitor.clinging()).any())

    def _observe(self) -> dict[str, Any]:
        start = time.perf_counter()
        scene = self.scene
        assert self._image_renderer is not None
        observation: dict[str, Any] = {
            name: self._image_renderer.capture(name, depth=False, instances=False).rgb for name in self.images
        }
        self.timings_s["render"] = time.perf_counter() - start
        data = scene.data
        observation["joint_positions"] = _within(data.qpos[self._qpos_adr], MAX_JOINT_RAD)
        observation["joint_velocities"] = _within(data.qvel[self._qvel_adr], MAX_JOINT_SPEED_RAD_S)
        T_world_tcp = _IDENTITY.copy()
        T_world_tcp[:3, :3] = data.site_xmat[self._tcp].reshape(3, 3)
        T_world_tcp[:3, 3] = data.site_xpos[self._tcp]
        observation["T_world_tcp"] = T_world_tcp
        sensor = self._gripper.sensor
        dtype = np.int8 if sensor.upper is None else np.float32
        observation[sensor.key] = np.array([self._gripper.sense(scene.model, data)], dtype)
        observation["remaining"] = np.int64(len(self._in_bin))
        return observation

    def _copy_observation(self) -> dict[str, Any]:
        return {key: value.copy() for key, value in self._observation.items()}

    def _info(self) -> dict[str, Any]:
        scene = self.scene
        return {"is_success": len(scene.removed) == len(scene.instances), "truth": self._truth_arrays(self._in_bin)}

    def _release_scene(self) -> None:
        if self._image_renderer is not None:
            self._image_renderer.close()
        self._image_renderer = None
        for name in ("_monitor", "_gripper_servo"):
            self.__dict__.pop(name, None)  # They hold the scene.
        super()._release_scene()


def _within(values: Float[np.ndarray, "joints"], most: float) -> Float32[np.ndarray, "joints"]:
    """Return `values` cut off at plus and minus `most`."""
    rounded = values.astype(np.float32)
    np.maximum(rounded, -most, out=rounded)
    return np.minimum(rounded, most, out=rounded)
