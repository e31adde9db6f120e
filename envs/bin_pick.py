"""``simpick/BinPick-v0``: one step is one attempt to pick a part from the bin."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium.utils import EzPickle

from simpick.assets.library import get_part, library_part_names
from simpick.assets.robots.registry import get_robot
from simpick.envs.actions import decode_action
from simpick.envs.observations import observation_from_frame
from simpick.envs.spaces import action_space, observation_space
from simpick.errors import ConfigError
from simpick.motion import PickExecutor, PickResult
from simpick.records import CameraFrame, InstanceTruth, PickOutcome, PickRecord
from simpick.rendering.scene_renderer import SceneRenderer
from simpick.scene import Scene, SceneConfig, build_scene
from simpick.scene.workspace import tcp_workspace

SUCCESS_REWARD = 1.0
"""For each part delivered."""
ATTEMPT_COST = 0.1
"""For an attempt that delivered nothing."""
COLLISION_COST = 0.1
"""On top, for an attempt that ended in a collision."""

ABSTAINED = PickResult(PickOutcome.NO_GRASP, "the action abstained", (), 0.0, 0.0, (), (), ())
"""The result of an all-zero action."""

RENDER_MODES = ("rgb_array", "rgb_array_list")
RENDER_FPS = 25


class BinPickEnv(gymnasium.Env, EzPickle):
    """Empty a bin of parts with a robot arm, one attempt a step.

    **Observation** (`Dict`): see `simpick.envs.spaces.observation_table`; an overhead RGB-D image with instance
    ids, the camera's intrinsics and pose, the number of parts left and the last outcome.

    **Action** (`Box(-1, 1, (10,))`): TCP position in the workspace (3), 6D rotation (6), opening (1); see
    `simpick.envs.actions`, which turns grasps into actions. All zeros abstain.

    **Reward**: +1 for each part delivered, -0.1 for an attempt that delivered none, -0.1 more for a collision.

    **Termination**: the bin is empty, `max_consecutive_failures` attempts in a row delivered nothing (VGN's
    protocol), or the physics blew up (``simulation_fault``). **Truncation**: `max_picks` attempts.

    **Info** (reset and step): ``is_success`` (the bin is empty) and ``truth``, arrays for evaluation only; after a
    step also ``pick``, the `PickRecord`, and ``ended``, why the episode ended, or "".

    Rendering shows the `overview` camera: ``rgb_array`` the current frame, ``rgb_array_list`` every frame of the
    motion since the last call (25 a second of simulated time).
    """

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": RENDER_FPS}  # noqa: RUF012

    def __init__(
        self,
        parts: Sequence[str] = (),
        count: int = 12,
        gripper: Literal["jaw", "suction"] = "jaw",
        randomization: str = "default",
        max_consecutive_failures: int = 2,
        max_picks: int | None = None,
        scene_config: SceneConfig | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Make the environment; nothing is simulated before `reset`.

        `parts` are names or mesh files to draw the bin's `count` parts from (the whole library if empty).
        `scene_config` sets every detail instead of `parts`, `count`, `gripper` and `randomization`.

        Raises:
            ConfigError, UnknownPartError, MeshError: the configuration or a part is not valid.
        """
        EzPickle.__init__(
            self, parts, count, gripper, randomization, max_consecutive_failures, max_picks, scene_config, render_mode
        )
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ConfigError(f"render_mode must be None or one of {', '.join(RENDER_MODES)}, got {render_mode!r}")
        for name, value in (("max_consecutive_failures", max_consecutive_failures), ("max_picks", max_picks)):
            if value is not None and value < 1:
                raise ConfigError(f"{name} must be 1 or more, got {value}")
        self.scene_config = scene_config or SceneConfig(
            parts=tuple(parts) or tuple(library_part_names()), count=count, gripper=gripper, randomization=randomization
        )
        if self.scene_config.robot is None:
            raise ConfigError("robot must be the name of an arm, got None; nothing can be picked without one")
        get_robot(self.scene_config.robot)
        self.parts = tuple(get_part(name) for name in self.scene_config.parts)
        """The kinds of parts that the bin is filled from."""
        self.part_names = tuple(part.name for part in self.parts)
        self.render_mode = render_mode
        self.observation_space = observation_space(
            self.scene_config.overhead.width_px, self.scene_config.overhead.height_px
        )
        self.action_space = action_space()
        self.workspace = tcp_workspace(self.scene_config.bin)
        """Where actions may place the TCP."""
        self.timings_s: dict[str, float] = {}
        """Wall-clock seconds of the last reset or step: ``simulate`` and ``render``."""
        self.on_tick: Any = None
        """Called with the scene after every control period (10 ms) while the arm moves; for recording."""
        self.on_stage: Any = None
        """Called with a stage's name as the arm enters it; for recording."""
        self._max_consecutive_failures = max_consecutive_failures
        self._max_picks = max_picks
        self._scene: Scene | None = None
        self._renderer: SceneRenderer | None = None
        self._frames: list[np.ndarray] = []

    @property
    def scene(self) -> Scene:
        """Return the simulated scene.

        Raises:
            ConfigError: `reset` has not been called yet, or the environment is closed.
        """
        if self._scene is None:
            raise ConfigError("the environment has no scene yet: call reset() first")
        return self._scene

    def truth(self) -> tuple[InstanceTruth, ...]:
        """Return the true state of every part: for the oracle and for evaluation only."""
        return self.scene.truth()

    def instance_part_names(self) -> list[str]:
        """Return the part name of each instance in the scene, by instance number."""
        return [instance.part.name for instance in self.scene.instances]

    def capture(self, camera: str = "overhead") -> CameraFrame:
        """Return what a camera of the scene sees now."""
        self.scene  # noqa: B018 - raises before the first reset
        assert self._renderer is not None
        return self._renderer.capture(camera)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Fill a new bin. The same `seed` gives the same bin in any process.

        ``options={"scene_file": path}`` loads a scene saved by `Scene.save` instead.

        Raises:
            ConfigError: an option is unknown.
        """
        super().reset(seed=seed)
        options = dict(options or {})
        scene_file = options.pop("scene_file", None)
        if options:
            raise ConfigError(f"unknown reset options {sorted(options)}; valid: scene_file")
        self._release_scene()
        start = time.perf_counter()
        if scene_file is not None:
            self._scene = Scene.load(Path(scene_file))
        else:
            # An explicit seed names the bin; without one the environment's own generator goes on to the next.
            scene_seed = seed if seed is not None else int(self.np_random.integers(2**31))
            self._scene = build_scene(self.scene_config, scene_seed)
        self._executor = PickExecutor(self._scene, on_step=self._tick, on_stage=self._stage)
        self._renderer = SceneRenderer(self._scene)
        self._picks = self._failures = 0
        self._last_outcome: PickOutcome | None = None
        self._frames.clear()
        self._next_frame_s = 0.0
        self.timings_s = {"simulate": time.perf_counter() - start}
        return self._observe(), self._info()

    def step(self, action: np.ndarray) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Attempt the pick that `action` commands and look again."""
        start = time.perf_counter()
        command = decode_action(action, self.workspace)
        result = ABSTAINED if command is None else self._executor.execute(*command)
        self.timings_s = {"simulate": time.perf_counter() - start}
        delivered = len(result.delivered)
        self._failures = 0 if delivered else self._failures + 1
        self._last_outcome = result.outcome
        reward = SUCCESS_REWARD * delivered - ATTEMPT_COST * (delivered == 0)
        reward -= COLLISION_COST * (result.outcome is PickOutcome.COLLISION)
        pick = self._record(result)
        self._picks += 1
        ended = self._ended(pick)
        truncated = not ended and self._max_picks is not None and self._picks >= self._max_picks
        info = self._info() | {"pick": pick, "ended": "max_picks" if truncated else ended}
        return self._observe(), float(reward), bool(ended), truncated, info

    def render(self) -> Any:
        """Return what `render_mode` promises; None without one."""
        if self.render_mode == "rgb_array":
            return self.capture("overview").rgb
        if self.render_mode == "rgb_array_list":
            frames = [*self._frames, self.capture("overview").rgb]
            self._frames.clear()
            return frames
        gymnasium.logger.warn("render() needs render_mode='rgb_array' or 'rgb_array_list' at gymnasium.make")
        return None

    def close(self) -> None:
        """Free the renderer and the scene; may be called again."""
        self._release_scene()

    def _release_scene(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = self._scene = None

    def _tick(self, scene: Scene) -> None:
        if self.on_tick is not None:
            self.on_tick(scene)
        if self.render_mode == "rgb_array_list" and scene.time_s >= self._next_frame_s:
            self._next_frame_s = scene.time_s + 1 / RENDER_FPS
            self._frames.append(self.capture("overview").rgb)

    def _stage(self, name: str) -> None:
        if self.on_stage is not None:
            self.on_stage(name)

    def _observe(self) -> dict[str, Any]:
        start = time.perf_counter()
        frame = self.capture("overhead")
        self.timings_s["render"] = time.perf_counter() - start
        index = {name: k for k, name in enumerate(self.part_names)}
        instance_parts = [index[instance.part.name] for instance in self.scene.instances]
        return observation_from_frame(frame, instance_parts, len(self.scene.parts_in_bin()), self._last_outcome)

    def _info(self) -> dict[str, Any]:
        truth = self.truth()
        return {
            "is_success": not self.scene.parts_in_bin(),
            "truth": {
                "instance": np.array([t.instance for t in truth], np.int64),
                "T_world_part": np.array([t.T_world_part for t in truth]).reshape(-1, 4, 4),
                "in_bin": np.array([t.in_bin for t in truth], bool),
            },
        }

    def _record(self, result: PickResult) -> PickRecord:
        fields = {field.name: getattr(result, field.name) for field in dataclasses.fields(PickResult)}
        remaining = len(self.scene.parts_in_bin())
        return PickRecord(
            pick=self._picks, target_part=None, target_instance=None, remaining=remaining, pose_error=None, **fields
        )

    def _ended(self, pick: PickRecord) -> str:
        if pick.outcome is PickOutcome.SIMULATION_FAULT:
            return pick.outcome.value
        if pick.remaining == 0:
            return "cleared"
        return "consecutive_failures" if self._failures >= self._max_consecutive_failures else ""
