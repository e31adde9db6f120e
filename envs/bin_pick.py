"""``simpick/BinPick-v0``: one step is one pick from the bin."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.utils import EzPickle

from simpick.assets.grippers import get_gripper
from simpick.envs.actions import decode_action
from simpick.envs.bin_env import BinEnv, check_count, part_pool
from simpick.envs.observations import observation_from_frame
from simpick.envs.spaces import action_space, observation_space
from simpick.errors import ConfigError
from simpick.motion import PickExecutor
from simpick.records import CameraFrame, PickOutcome, PickRecord, PickResult
from simpick.scene import Scene, SceneConfig
from simpick.scene.workspace import tcp_workspace

SUCCESS_REWARD = 1.0
"""Per part delivered."""
FAILED_PICK_COST = 0.1
"""For a pick that delivered nothing, abstentions included."""
COLLISION_COST = 0.1
"""In addition, for a pick that ended in a collision."""

ABSTAINED = PickResult(PickOutcome.NO_GRASP, "the action abstained")
"""The result of an all-zero action."""


class BinPickEnv(BinEnv, EzPickle):
    """Empty a bin of parts with a robot arm: one step is one pick.

    ## Description

    A bin of rigid parts stands in front of an arm with a gripper; a chute stands beside it. An action names where the
    gripper closes. The arm moves there from home, closes, lifts, carries what it holds to the chute, releases it and
    returns home. It stops where it is blocked. Delivered parts are removed from the scene.

    `render` shows the `overview` camera: ``rgb_array`` the present frame, ``rgb_array_list`` every frame of the motion
    since the last call (25 per second of simulated time).

    ## Action Space

    `Box(-1.0, 1.0, (10,), float32)`; `simpick.envs.actions` converts TCP poses to actions and back.

    | Num | Action | At -1 | At 1 | Unit |
    |---|---|---|---|---|
    | 0-2 | TCP position x, y, z in the world | lower corner of `workspace` | upper corner | m |
    | 3-8 | first two columns of the TCP's rotation (6D representation) | -1 | 1 | - |
    | 9 | opening of the gripper before it closes | 0 | `Gripper.max_opening_m` | m |

    An action of zeros abstains: the arm stays at home, and the step counts as a pick that delivered nothing.

    ## Observation Space

    `Dict`, with the overhead image at its default size:

    | Key | Observation | Min | Max | Shape and type | Unit |
    |---|---|---|---|---|---|
    | `rgb` | overhead image | 0 | 255 | (480, 640, 3) uint8 | - |
    | `depth` | distance along the optical axis; 0: no reading | 0 | 10 | (480, 640) float32 | m |
    | `segmentation` | 1 + instance id of the part seen in each pixel; 0: none | 0 | 50 | (480, 640) uint8 | - |
    | `instance_parts` | index into `part_names` per instance id, padded with -1 | -1 | 49 | (50,) int16 | - |
    | `camera_matrix` | intrinsics K; pixel centres at +0.5 | 0 | 100000 | (3, 3) float64 | px |
    | `T_world_camera` | camera pose, OpenCV axes (+z forward) | -10 | 10 | (4, 4) float64 | m |
    | `remaining` | parts still in the bin | 0 | 50 | () int64 | - |
    | `last_outcome` | 1 + index of the last outcome in `OUTCOMES`; 0: no pick yet | 0 | 11 | () int64 | - |

    ## Information

    `reset` and `step` return ``is_success`` (the bin is empty) and ``truth``, arrays with one row per instance for
    evaluation only, NaN once an instance is removed. `step` adds ``pick``, the `PickRecord` of this step, and
    ``ended``, the reason why the episode ended, or "".

    ## Rewards

    +1 per part delivered, -0.1 for a pick that delivered none, and another -0.1 for a collision.

    ## Starting State

    `count` parts drawn from `parts` were dropped into the bin and lie still; the arm is at home. Everything random
    about the bin follows from the seed. ``options={"scene_file": path}`` loads a scene saved by `Scene.save` instead.

    ## Episode End

    1. Termination: the bin is empty (``cleared``).
    2. Termination: `max_consecutive_failures` picks in a row delivered nothing (``consecutive_failures``).
    3. Termination: the physics diverged (``simulation_fault``).
    4. Truncation: `max_picks` picks.

    ## Arguments

    | Parameter | Default | Description |
    |---|---|---|
    | `parts` | `()` | names or mesh files that the bin is filled from; the whole library if empty |
    | `count` | `12` | parts in the bin, 1 to 50 |
    | `gripper` | `'jaw'` | name of the gripper: jaw, suction, or one that another package adds |
    | `randomization` | `'default'` | how much looks vary with the seed: default, none or strong |
    | `max_consecutive_failures` | `2` | picks in a row without a delivery that end the episode |
    | `max_picks` | `None` | picks that end the episode; None for no limit |
    | `scene_config` | `None` | sets every detail instead of the first four arguments |
    | `render_mode` | `None` | None, rgb_array or rgb_array_list |

    ## Version History

    * v0: initial version.
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
        """Make the environment; nothing is simulated before `reset`. See the class for the arguments.

        Raises:
            ConfigError, UnknownPartError, MeshError: the configuration or a part is not valid.
        """
        EzPickle.__init__(
            self, parts, count, gripper, randomization, max_consecutive_failures, max_picks, scene_config, render_mode
        )
        check_count("max_consecutive_failures", max_consecutive_failures, optional=False)
        check_count("max_picks", max_picks)
        pool = part_pool(parts)
        config = scene_config or SceneConfig(parts=pool, count=count, gripper=gripper, randomization=randomization)
        super().__init__(config, render_mode)
        self.observation_space = observation_space(
            self.scene_config.overhead.width_px, self.scene_config.overhead.height_px
        )
        self.action_space = action_space()
        self.workspace = tcp_workspace(self.scene_config.bin)
        """Where actions may place the TCP."""
        self._max_opening_m = get_gripper(self.scene_config.gripper).max_opening_m
        self.on_stage: Any = None
        """Called with a stage's name as the arm enters it; for recording."""
        self.on_look: Callable[[CameraFrame, np.ndarray], np.ndarray | None] | None = None
        """Called with the wrist camera's image and the target T_world_tcp when the arm rests over the bin, before it
        descends. Returns a corrected T_world_tcp, or None to keep it; a pose far off or out of reach is ignored."""
        self._max_consecutive_failures = max_consecutive_failures
        self._max_picks = max_picks

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Fill a new bin. The same `seed` gives the same bin in any process.

        ``options={"scene_file": path}`` loads a scene saved by `Scene.save` instead.

        Raises:
            ConfigError: an option is unknown, or the loaded scene's observations or actions would be others than this
                environment's.
        """
        super().reset(seed=seed)
        start = time.perf_counter()
        scene = self._new_scene(seed, options)
        self._check_loaded(scene)
        self._executor = PickExecutor(scene, on_step=self._tick, on_stage=self._stage)
        self._picks = self._failures = 0
        self._last_outcome: PickOutcome | None = None
        self.timings_s = {"simulate": time.perf_counter() - start}
        return self._observe(), self._info()

    def step(self, action: np.ndarray) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Make the pick that `action` commands and look again.

        Raises:
            ConfigError: the action is not ten finite numbers, or `reset` has not been called since the environment was
                made or closed.
        """
        self.scene  # noqa: B018 - raises before the first reset
        start = time.perf_counter()
        command = decode_action(action, self.workspace, self._max_opening_m)
        self._look_s = 0.0
        self._executor.on_look = None if self.on_look is None else self._look
        result = ABSTAINED if command is None else self._executor.execute(*command)
        self.timings_s = {"simulate": time.perf_counter() - start - self._look_s, "look": self._look_s}
        delivered = len(result.delivered)
        self._failures = 0 if delivered else self._failures + 1
        self._last_outcome = result.outcome
        reward = SUCCESS_REWARD * delivered - FAILED_PICK_COST * (delivered == 0)
        reward -= COLLISION_COST * (result.outcome is PickOutcome.COLLISION)
        pick = PickRecord(**vars(result), pick=self._picks, remaining=len(self.scene.parts_in_bin()))
        self._picks += 1
        ended = self._ended(pick)
        truncated = not ended and self._max_picks is not None and self._picks >= self._max_picks
        info = self._info() | {"pick": pick, "ended": "max_picks" if truncated else ended}
        return self._observe(), float(reward), bool(ended), truncated, info

    def _release_scene(self) -> None:
        # It holds the scene and this environment's methods: a cycle that only Python's garbage collector would free,
        # which counts objects, not the 26 MB of each model.
        self.__dict__.pop("_executor", None)
        super()._release_scene()

    def _check_loaded(self, scene: Scene) -> None:
        """Raise ConfigError where a loaded scene does not fit this environment's spaces."""
        loaded, own = scene.config, self.scene_config
        names = {instance.part.name for instance in scene.instances}
        same = (loaded.overhead.width_px, loaded.overhead.height_px) == (own.overhead.width_px, own.overhead.height_px)
        same &= (loaded.robot, loaded.gripper, loaded.bin) == (own.robot, own.gripper, own.bin)
        if not same or not names <= set(self.part_names):
            self.close()
            raise ConfigError(
                "a loaded scene must have this environment's arm, gripper, bin, image size and parts, got others;"
                " make the environment with scene_config=Scene.load(path).config"
            )

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
        inside = self.scene.parts_in_bin()
        return {"is_success": not inside, "truth": self._truth_arrays(inside)}

    def _ended(self, pick: PickRecord) -> str:
        if pick.outcome is PickOutcome.SIMULATION_FAULT:
            return pick.outcome.value
        if pick.remaining == 0:
            return "cleared"
        return "consecutive_failures" if self._failures >= self._max_consecutive_failures else ""
