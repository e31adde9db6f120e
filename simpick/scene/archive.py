"""The file that a scene is saved in: configuration, parts' hashes and MuJoCo's state, in one ``.npz``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.caching import read_arrays, write_arrays
from simpick.config import Config, NonNegativeInt, from_json
from simpick.errors import ConfigError, OutputError, SceneError
from simpick.json_text import load_json
from simpick.scene.config import SceneConfig

_FORMAT = "simpick-scene-2"


@dataclass(frozen=True)
class _Header(Config):
    """The values of the file that are no arrays."""

    mujoco: str
    config: SceneConfig
    seed: NonNegativeInt
    part_hashes: tuple[str, ...]
    removed: tuple[NonNegativeInt, ...]
    redropped: NonNegativeInt

    def _check_rules(self) -> None:
        instances = len(self.part_hashes)
        if len(set(self.removed)) < len(self.removed) or max(self.removed, default=-1) >= instances:
            raise ConfigError(f"removed must hold different instances below {instances}, got {self.removed}")


_SLEEP_PREFIX = "sleep/"
STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""All that MuJoCo integrates, controls and warm start included."""


@dataclass(frozen=True, eq=False)
class SceneArchive:
    """What the file holds."""

    mujoco_version: str
    """Of the MuJoCo that wrote it, whose state's layout it is."""
    config: SceneConfig
    seed: int
    part_hashes: tuple[str, ...]
    """`Part.content_hash` of every instance."""
    removed: tuple[int, ...]
    redropped: int
    state: Float[np.ndarray, "state"]
    """MuJoCo's integration state."""
    sleep: dict[str, np.ndarray]
    """Who sleeps, from `sleep_state`."""
    adhesion_n: Float[np.ndarray, "geoms"]
    """The model's `geom_adhesion`: a suction gripper's vacuum, which is no part of MuJoCo's state."""


def write_archive(path: Path, archive: SceneArchive) -> None:
    """Write `archive` to `path`; raises OutputError where that is impossible."""
    header = {
        "format": _FORMAT,
        "mujoco": archive.mujoco_version,
        "config": archive.config.to_json(),
        "seed": archive.seed,
        "part_hashes": archive.part_hashes,
        "removed": archive.removed,
        "redropped": archive.redropped,
    }
    if not path.parent.is_dir():
        raise OutputError(f"cannot write the scene to {path}: no such folder; choose a writable folder")
    sleep = {_SLEEP_PREFIX + name: value for name, value in archive.sleep.items()}
    arrays = {"header": np.array(json.dumps(header)), "state": archive.state, "adhesion_n": archive.adhesion_n}
    write_arrays(path, arrays | sleep)


def read_archive(path: Path) -> SceneArchive:
    """Read what `write_archive` wrote; raises SceneError where the file is missing, foreign or corrupt."""
    try:
        arrays = read_arrays(path)
        content = load_json(str(arrays["header"]))
        if not isinstance(content, dict) or (found := content.pop("format", None)) is None:
            raise ValueError("its header states no format")
        if found != _FORMAT:
            raise SceneError(f"{path} must have the format {_FORMAT}, got {found!s:.60}; build the scene again")
        header = from_json(_Header, content, complete=True)
        return SceneArchive(
            mujoco_version=header.mujoco,
            config=header.config,
            seed=header.seed,
            part_hashes=header.part_hashes,
            removed=header.removed,
            redropped=header.redropped,
            state=_numbers(arrays, "state"),
            sleep={
                name.removeprefix(_SLEEP_PREFIX): value
                for name, value in arrays.items()
                if name.startswith(_SLEEP_PREFIX)
            },
            adhesion_n=_numbers(arrays, "adhesion_n"),
        )
    except FileNotFoundError as error:
        raise SceneError(f"no scene file at {path}; write one with Scene.save") from error
    except (OSError, ValueError, KeyError) as error:
        raise SceneError(f"{path} is not a scene file that simpick wrote: {error}") from error


def _numbers(arrays: dict[str, np.ndarray], name: str) -> Float[np.ndarray, "n"]:
    values = arrays[name]
    if values.dtype != np.float64 or values.ndim != 1 or not np.isfinite(values).all():
        raise ValueError(f"{name} must hold finite numbers in double precision, in one dimension")
    return values
