"""``simpick/BinPick-v0``: one step is one attempt to pick a part from the bin."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.utils import EzPickle

from simpick.envs.actions import decode_action
from simpick.envs.bin_env import BinEnv, part_pool
from simpick.envs.observations import observation_from_frame
from simpick.envs.spaces import action_space, observation_space
from simpick.errors import ConfigError
from simpick.motion import PickExecutor
from simpick.records import CameraFrame, PickOutcome, PickRecord, PickResult
from simpick.scene import SceneConfig
from simpick.scene.workspace import tcp_workspace

SUCCESS_REWARD = 1.0
"""For each part delivered."""
ATTEMPT_COST = 0.1
"""For an attempt that delivered nothing."""
COLLISION_COST = 0.1
"""On top, for an attempt that ended in a collision."""

ABSTAINED = PickResult(PickOutcome.NO_GRASP, "the action abstained")
"""The result of an all-zero action."""


class BinPickEnv(BinEnv, EzPickle):
    """Empty a bin of parts with a robot arm, one attempt a step.

    **Observation** (`Dict`): see `simpick.envs.spaces.observation_table`; an overhead RGB-D image with instance
    ids, the camera's intrinsics and pose, the number of parts left and the last outcome.

    **Action** (`Box(-1, 1, (10,))`): TCP position in the workspace (3), 6D rotation (6), opening (1); see
    `simpick.envs.actions`, which turns grasps into actions. All zeros abstain.

    **Reward**: +1 for each part delivered, -0.1 for an attempt that delivered none, -0.1 more for a collision.

    **Termination**: the bin is empty, `max_consecutive_failures` attempts in a row delivered nothing (VGN's
    protocol), or the physics blew up (``simulation_fault``). **Truncation**: `max_picks` attempts.

    **Info** (reset and step): ``is_success`` (the bin is empty) and ``truth``, arrays for evaluation only
    with a row for each instance, NaN once it is removed; after a step also ``pick``, the `PickRecord`, and ``ended``,
    why the episode ended, or "".

    Rendering shows the `overview` camera: ``rgb_array`` the current frame, ``rgb_array_list`` every frame of the
    motion since the last call (25 a second of simulated time).
    """

    def __init__(
        self,
        parts: Sequence[str] = (),
        count: int = 12,
        gripper: str = "jaw",
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
        for name, value in (("max_consecutive_failures", max_consecutive_failures), ("max_picks", max_picks)):
            if value is not None and value < 1:
                raise ConfigError(f"{name} must be 1 or more, got {value}")
        pool = part_pool(parts)
        config = scene_config or SceneConfig(parts=pool, count=count, gripper=gripper, randomization=randomization)
        super().__init__(config, render_mode)
        self.observation_space = observation_space(
            self.scene_config.overhead.width_px, self.scene_config.overhead.height_px
        )
        self.action_space = action_space()
        self.workspace = tcp_workspace(self.scene_config.bin)
        """Where actions may place the TCP."""
        self.on_stage: Any = None
        """Called with a stage's name as the arm enters it; for recording."""
        self.on_look: Callable[[CameraFrame, np.ndarray], np.ndarray | None] | None = None
        """Asked with the wrist camera's image and the T_world_tcp aimed at, when the arm stands over the bin before it
        descends. Returns a corrected T_world_tcp, or None to keep it; what is far off or out of reach is not taken."""
        self._max_consecutive_failures = max_consecutive_failures
        self._max_picks = max_picks

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Fill a new bin. The same `seed` gives the same bin in any process.

        ``options={"scene_file": path}`` loads a scene saved by `Scene.save` instead.

        Raises:
            ConfigError: an option is unknown.
        """
        super().reset(seed=seed)
        start = time.perf_counter()
        scene = self._new_scene(seed, options)
        self._executor = PickExecutor(scene, on_step=self._tick, on_stage=self._stage)
        self._picks = self._failures = 0
        self._last_outcome: PickOutcome | None = None
        self.timings_s = {"simulate": time.perf_counter() - start}
        return self._observe(), self._info()

    def step(self, action: np.ndarray) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Attempt the pick that `action` commands and look again."""
        start = time.perf_counter()
        command = decode_action(action, self.workspace)
        self._look_s = 0.0
        self._executor.on_look = None if self.on_look is None else self._look
        result = ABSTAINED if command is None else self._executor.execute(*command)
        self.timings_s = {"simulate": time.perf_counter() - start - self._look_s, "look": self._look_s}
        delivered = len(result.delivered)
        self._failures = 0 if delivered else self._failures + 1
        self._last_outcome = result.outcome
        reward = SUCCESS_REWARD * delivered - ATTEMPT_COST * (delivered == 0)
        reward -= COLLISION_COST * (result.outcome is PickOutcome.COLLISION)
        pick = PickRecord(**vars(result), pick=self._picks, remaining=len(self.scene.parts_in_bin()))
        self._picks += 1
        ended = self._ended(pick)
        truncated = not ended and self._max_picks is not None and self._picks >= self._max_picks
        info = self._info() | {"pick": pick, "ended": "max_picks" if truncated else ended}
        return self._observe(), float(reward), bool(ended), truncated, info

    def _look(self, T_world_tcp: np.ndarray) -> np.ndarray | None:
        assert self.on_look is not None
        start = time.perf_counter()
        corrected = self.on_look(self.capture("wrist"), T_world_tcp)
        self._look_s = time.perf_counter() - start
        return corrected

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
        return {"is_success": not self.scene.parts_in_bin(), "truth": self._truth_arrays()}

    def _ended(self, pick: PickRecord) -> str:
        if pick.outcome is PickOutcome.SIMULATION_FAULT:
            return pick.outcome.value
        if pick.remaining == 0:
            return "cleared"
        return "consecutive_failures" if self._failures >= self._max_consecutive_failures else ""
