"""`BinEnv`: scene, cameras, rendering and truth, which both environments share."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from simpick.assets import get_part, library_part_names
from simpick.assets.robots.registry import get_robot
from simpick.errors import ConfigError
from simpick.records import CameraFrame, InstanceTruth
from simpick.rendering.scene_renderer import SceneRenderer
from simpick.scene import Scene, SceneConfig, build_scene
from simpick.scene.composition import check_fit

RENDER_MODES = ("rgb_array", "rgb_array_list")


def part_pool(parts: Sequence[str]) -> tuple[str, ...]:
    """Return the names that a bin is filled from: these, or the whole library if there are none.

    Raises:
        ConfigError: a single name stands where a list of names is meant.
    """
    if isinstance(parts, str):
        raise ConfigError(f"parts must be a list of names or mesh files, got {parts!r}; write [{parts!r}]")
    if not isinstance(parts, Iterable):
        raise ConfigError(f"parts must be a list of names or mesh files, got {parts!r}; () takes the whole library")
    return tuple(parts) or tuple(library_part_names())


def check_count(name: str, value: object, *, optional: bool = True) -> None:
    """Raise ConfigError unless `value` is an integer of 1 or more, or None where that means no limit."""
    if value is None and optional:
        return
    if isinstance(value, bool) or not isinstance(value, Integral) or int(value) < 1:
        none = ", or None for no limit" if optional else ""
        raise ConfigError(f"{name} must be an integer of 1 or more{none}, got {value!r}")


class BinEnv(gymnasium.Env):
    """A bin, an arm and cameras; subclasses define steps and observations."""

    metadata = {"render_modes": list(RENDER_MODES), "render_fps": 25}  # noqa: RUF012

    def __init__(self, scene_config: SceneConfig, render_mode: str | None) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise ConfigError(f"render_mode must be None or one of {', '.join(RENDER_MODES)}, got {render_mode!r}")
        if not isinstance(scene_config, SceneConfig):
            raise ConfigError(f"scene_config must be a SceneConfig or None, got {scene_config!r}")
        if scene_config.robot is None:
            raise ConfigError("robot must be the name of an arm, got None; nothing can be picked without one")
        self.scene_config = scene_config
        self.robot = get_robot(scene_config.robot)
        self.parts = tuple(get_part(name) for name in scene_config.parts)
        """The kinds of parts that the bin is filled from."""
        check_fit(self.parts, scene_config.bin)
        self.part_names = tuple(part.name for part in self.parts)
        if len(set(self.part_names)) < len(self.parts):
            raise ConfigError(
                f"parts must have different names, got {', '.join(self.part_names)}; register one of them under "
                "another name with: simpick parts add FILE --name NAME"
            )
        self.render_mode = render_mode
        self.timings_s: dict[str, float] = {}
        """Wall-clock seconds of the last reset or step: ``simulate``, ``render`` and, in picks, ``look`` (closer)."""
        self.on_tick: Callable[[Scene], None] | None = None
        """Called with the scene after every control period (10 ms) while the arm moves; for recording."""
        self._scene: Scene | None = None
        self._renderer: SceneRenderer | None = None
        self._frames: list[np.ndarray] = []
        self._next_frame_s = 0.0

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
        """Return the image of a camera of the scene."""
        self.scene  # noqa: B018 - raises before the first reset
        assert self._renderer is not None
        return self._renderer.capture(camera)

    def render(self) -> Any:
        """Return what `render_mode` promises; None without one."""
        if self.render_mode == "rgb_array":
            return self._overview()
        if self.render_mode == "rgb_array_list":
            frames = [*self._frames, self._overview()]
            self._frames.clear()
            return frames
        gymnasium.logger.warn("render() needs render_mode='rgb_array' or 'rgb_array_list' at gymnasium.make")
        return None

    def close(self) -> None:
        """Free the renderer and the scene; may be called again."""
        self._release_scene()

    def _new_scene(self, seed: int | None, options: dict[str, Any] | None) -> Scene:
        """Replace the scene by a new one, or by the one in ``options["scene_file"]``."""
        if options is not None and not isinstance(options, Mapping):
            raise ConfigError(f"options must be a dict or None, got {options!r}; valid keys: scene_file")
        options = dict(options or {})
        scene_file = options.pop("scene_file", None)
        if options:
            raise ConfigError(f"unknown reset options {sorted(options)}; valid: scene_file")
        if not isinstance(scene_file, str | os.PathLike | None):
            raise ConfigError(f"options['scene_file'] must be a path, got {scene_file!r}")
        self._release_scene()
        if scene_file is not None:
            self._scene = Scene.load(Path(scene_file))
        else:
            # An explicit seed names the bin; without one the environment's own generator draws the next.
            scene_seed = seed if seed is not None else int(self.np_random.integers(2**31))
            self._scene = build_scene(self.scene_config, scene_seed)
        self._renderer = SceneRenderer(self._scene)
        self._frames.clear()
        self._next_frame_s = 0.0
        return self._scene

    def _release_scene(self) -> None:
        if self._renderer is not None:
            self._renderer.close()
        self._renderer = self._scene = None

    @property
    def _watched(self) -> bool:
        """Return whether `_tick` has anything to do."""
        return self.on_tick is not None or self.render_mode == "rgb_array_list"

    def _tick(self, scene: Scene) -> None:
        """Record the scene after a control period, and film it where `render_mode` asks for it."""
        if self.on_tick is not None:
            self.on_tick(scene)
        if self.render_mode == "rgb_array_list" and scene.time_s >= self._next_frame_s:
            self._next_frame_s = scene.time_s + 1 / self.metadata["render_fps"]
            self._frames.append(self._overview())

    def _overview(self) -> np.ndarray:
        self.scene  # noqa: B018 - raises before the first reset
        assert self._renderer is not None
        return self._renderer.capture("overview", depth=False, instances=False).rgb

    def _truth_arrays(self, parts_in_bin: Sequence[int]) -> dict[str, np.ndarray]:
        """Return the truth as arrays with one row for each instance, for ``info``.

        The rows of removed parts stay, as NaN, for gymnasium's vector environments stack arrays of equal shape only.
        """
        scene = self.scene
        T_world_part = scene.Ts_world_part()
        if scene.removed:
            T_world_part[list(scene.removed)] = np.nan
        in_bin = np.zeros(len(T_world_part), bool)
        in_bin[list(parts_in_bin)] = True
        return {"T_world_part": T_world_part, "in_bin": in_bin}
