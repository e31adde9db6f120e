"""The pose benchmark's bins: 50 fixed bins of library parts, seen from above, the same for every pose estimator.

Bins and seeds are listed here and do not change when the library grows. Each bin is simulated and rendered once and its
view is cached, so that later runs only estimate and score.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from simpick.assets.library import get_part
from simpick.caching import cache_dir, cache_key, cached_arrays
from simpick.errors import ConfigError
from simpick.geometry import Pinhole
from simpick.pose_eval.bin_images import BinView, view_bin
from simpick.pose_eval.pose_images import PoseTruth
from simpick.records import CameraFrame
from simpick.rendering import Visibility
from simpick.rendering.camera_effects import PHOTO_EFFECTS
from simpick.scene import SceneConfig
from simpick.scene.randomization import RANDOMIZATIONS

MIXED_SEEDS = range(41_000, 41_030)
"""Bins in which each part is drawn from `MIXED_PARTS`."""
MIXED_COUNTS = (12, 30, 50)
"""Numbers of parts, in turn: of 12, nearly all are unoccluded; of 50, half are partly or fully occluded."""
HOMOGENEOUS_SEEDS = range(42_000, 42_020)
"""Bins of one kind of part each, in the order of `HOMOGENEOUS_PARTS`."""
HOMOGENEOUS_COUNTS = (40, 12)
"""Numbers of parts, in turn."""
Look = Literal["default", "photo"]
"""The simulator's plain images, or the same bins in the look of a photograph."""
HOMOGENEOUS_PARTS = (
    "pipe_tee",
    "hex_bolt",
    "l_bracket",
    "spur_gear",
    "crane_hook",
    "sensor_housing",
    "connecting_rod",
    "hub_flange",
    "cable_clip",
    "eye_bolt",
    "pipe_elbow",
    "clevis_fork",
    "bushing",
    "terminal_block",
    "keyed_shaft",
    "pillow_block",
    "hex_nut",
    "hinge_leaf",
    "crank_arm",
    "hose_barb",
)
MIXED_PARTS = tuple(
    sorted(
        (
            *HOMOGENEOUS_PARTS,
            "clevis_pin",
            "snap_clip",
            "socket_screw",
            "star_knob",
            "tri_flange",
            "vee_pulley",
            "wing_nut",
            "z_bracket",
        )
    )
)

# Increase if a change of code alters scenes or images of the same bins, which the cache key cannot show.
_VERSION = 1
# The same for images in the look of a photograph.
_PHOTO_VERSION = 1
_ARRAYS = ("rgb", "depth_m", "instances", "camera", "T_world_camera", "names", "truths", "Ts_truth", "fractions")


@dataclass(frozen=True)
class BenchmarkBin:
    """One of the fixed bins, in one of its looks."""

    kind: Literal["mixed", "homogeneous"]
    seed: int
    config: SceneConfig
    """Without the arm: at its home pose it is outside the overhead camera's image."""
    look: Look = "default"


def benchmark_bins(count: int | None = None, look: Look = "default") -> tuple[BenchmarkBin, ...]:
    """Return the first `count` bins of the pose benchmark, or all, in one of their looks.

    Each group of five holds three mixed bins and every number of parts, so that the first bins represent all.

    Raises:
        ConfigError: there are not so many bins.
    """
    mixed = [
        BenchmarkBin("mixed", seed, _config(MIXED_PARTS, MIXED_COUNTS[k % len(MIXED_COUNTS)]), look)
        for k, seed in enumerate(MIXED_SEEDS)
    ]
    homogeneous = [
        BenchmarkBin("homogeneous", seed, _config((part,), HOMOGENEOUS_COUNTS[k % len(HOMOGENEOUS_COUNTS)]), look)
        for k, (seed, part) in enumerate(zip(HOMOGENEOUS_SEEDS, HOMOGENEOUS_PARTS, strict=True))
    ]
    bins = [bin for k in range(10) for bin in (*mixed[3 * k : 3 * k + 3], *homogeneous[2 * k : 2 * k + 2])]
    if count is not None and not 1 <= count <= len(bins):
        raise ConfigError(f"bins of the pose benchmark must be between 1 and {len(bins)}, got {count}")
    return tuple(bins[:count])


def load_view(bin: BenchmarkBin) -> BinView:
    """Return the overhead camera's view of a bin from the cache, or simulate, render and cache it.

    Several processes may call this at once; a damaged file is replaced.
    """
    arrays = cached_arrays(view_path(bin), _ARRAYS, lambda: _arrays(fresh_view(bin)[0]))
    return _view(bin.seed, arrays, bin.config.parts)


def fresh_view(bin: BenchmarkBin) -> tuple[BinView, tuple[Visibility, ...]]:
    """Simulate and render a bin; return the overhead camera's view, and the visibility of each of its truths."""
    return view_bin(bin.config, bin.seed, photo=bin.look == "photo")


def view_path(bin: BenchmarkBin) -> Path:
    """Return the cache file of a bin's view; its name is a hash of everything that the view depends on."""
    photo = (_PHOTO_VERSION, repr(RANDOMIZATIONS["photo"]), repr(PHOTO_EFFECTS)) if bin.look == "photo" else ()
    key = cache_key(
        _VERSION,
        bin.seed,
        repr(bin.config),
        repr(RANDOMIZATIONS[bin.config.randomization]),
        *(f"{name} {get_part(name).content_hash}" for name in bin.config.parts),
        mujoco.__version__,
        *photo,
    )
    return cache_dir() / "yardstick" / f"{bin.kind}-{bin.seed}-{key}.npz"


def fingerprint(view: BinView) -> str:
    """Return a hash of image, depth and truth: figures from views with equal fingerprints are comparable.

    OpenGL drivers differ by one grey level in a few pixels, so fingerprints may differ across machines.
    """
    depth_m = view.frame.depth_m
    assert depth_m is not None
    digest = hashlib.sha256()
    for array in (view.frame.rgb, depth_m, *(truth.T_camera_part for truth in view.truths)):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:12]


def _config(parts: tuple[str, ...], count: int) -> SceneConfig:
    return SceneConfig(parts=parts, count=count, robot=None, randomization="default")


def _arrays(view: BinView) -> dict[str, np.ndarray]:
    frame, c = view.frame, view.frame.camera
    assert frame.depth_m is not None and frame.instances is not None
    values: tuple[np.ndarray, ...] = (
        frame.rgb,
        frame.depth_m,
        frame.instances.astype(np.int16),
        np.array([c.width, c.height, c.fx, c.fy, c.cx, c.cy]),
        frame.T_world_camera,
        np.array([part.name for part in view.parts]),
        np.array([truth.instance for truth in view.truths], int),
        np.array([truth.T_camera_part for truth in view.truths]).reshape(-1, 4, 4),
        np.array([truth.visible_fraction for truth in view.truths]),
    )
    return dict(zip(_ARRAYS, values, strict=True))


def _view(seed: int, arrays: dict[str, np.ndarray], candidates: tuple[str, ...]) -> BinView:
    rgb, depth_m, instances, c, T_world_camera, names, numbers, Ts, fractions = (arrays[name] for name in _ARRAYS)
    camera = Pinhole(int(c[0]), int(c[1]), *(float(value) for value in c[2:]))
    parts = tuple(get_part(str(name)) for name in names)
    truths = tuple(
        PoseTruth(parts[n].name, T, float(f), int(n)) for n, T, f in zip(numbers, Ts, fractions, strict=True)
    )
    frame = CameraFrame(rgb, camera, T_world_camera, depth_m, instances.astype(np.int32))
    return BinView(seed, frame, parts, truths, candidates)
