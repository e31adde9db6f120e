"""Random cluttered bins of training parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from simpick.assets.part import Part
from simpick.assets.random_parts import random_part
from simpick.errors import SceneError
from simpick.scene import BinConfig, CameraConfig, PhysicsConfig, Scene, SceneConfig
from simpick.scene.builder import build_scene_of
from simpick.scene.randomization import RANDOMIZATIONS, Look, draw_look
from simpick.training.data.data_config import DataConfig, Split

_ATTEMPTS = 12
# Parts only need to settle in a plausible pile; nothing grips them. Takes a third of the time of the exact settings.
_PHYSICS = PhysicsConfig(
    timestep_s=0.004, noslip_iterations=0, impratio=1.0, solver_iterations=10, solver_tolerance=1e-5
)
# Share of the bin's volume that the parts' convex hulls may fill; a pile far above the rim takes long to settle.
_FULLEST = 0.45
# Other parts come from a pool that every process soon has cached; the shard's own part is new in each shard.
_OTHERS_POOL = 64


def random_part_seed(rng: np.random.Generator, split: Split) -> int:
    """Return the seed of a training part (even) or of a validation part (odd), so that the splits never share one."""
    return 2 * int(rng.integers(2**40)) + (split == "validation")


def random_bin(
    config: DataConfig, part: Part, rng: np.random.Generator, split: Split, *, aligned: bool = False
) -> Scene:
    """Return a settled bin with several instances of `part`, and often other parts of the same split.

    If `aligned`, the parts fall nearly in a common orientation, so that many lie flush on one another.

    The scene has the most lamps that a look can have; `relight` it before use.

    Raises:
        SceneError: parts did not settle in the bin in any of the attempts.
    """
    parts = _draw_instances(config, part, rng, split)
    standard = BinConfig()
    last: SceneError | None = None
    for _ in range(_ATTEMPTS):
        scale = rng.uniform(*config.bin_scale, size=2)
        bin = BinConfig(float(scale[0] * standard.length_m), float(scale[1] * standard.width_m))
        parts = _that_fit(parts, bin)
        scene_config = SceneConfig(
            parts=(part.name,),
            robot=None,
            bin=bin,
            overhead=CameraConfig(config.image_width_px, config.image_height_px),
            # Not used.
            overview=CameraConfig(16, 16),
            physics=_PHYSICS,
        )
        try:
            seed, look = int(rng.integers(2**31)), _richest_look(len(parts), rng)
            return build_scene_of(scene_config, parts, seed, look, aligned=aligned)
        except SceneError as error:
            # Too many for this bin, or not at rest: try fewer in another bin.
            last = error
            parts = parts[: max(1, 2 * len(parts) // 3)]
    raise SceneError(f"no bin of {part.name} came to rest in {_ATTEMPTS} attempts; the last: {last}")


def _draw_instances(config: DataConfig, part: Part, rng: np.random.Generator, split: Split) -> tuple[Part, ...]:
    count = int(rng.integers(config.count[0], config.count[1] + 1))
    if rng.random() >= config.mixed_share:
        return (part,) * count
    own = max(1, round(rng.uniform(*config.target_share) * count))
    pool = np.random.default_rng([config.seed, split == "validation", 1])
    seeds = [random_part_seed(pool, split) for _ in range(_OTHERS_POOL)]
    number = int(rng.integers(config.others[0], config.others[1] + 1))
    others = [random_part(seeds[k]) for k in rng.choice(_OTHERS_POOL, size=number, replace=False)]
    others = [other for other in others if other.name != part.name]
    drawn = [part] * own + [others[k] for k in rng.integers(len(others), size=count - own)]
    # One of the shard's own comes first and is never left out; the others follow in random order.
    return (part, *(drawn[k] for k in 1 + rng.permutation(count - 1)))


def _that_fit(parts: tuple[Part, ...], bin: BinConfig) -> tuple[Part, ...]:
    """Return the first parts, as many as fit into the bin; at least one."""
    volumes = np.cumsum([part.mesh.convex_hull.volume for part in parts])
    room = bin.length_m * bin.width_m * bin.depth_m
    return parts[: max(1, int(np.searchsorted(volumes, _FULLEST * room)))]


def _richest_look(count: int, rng: np.random.Generator) -> Look:
    most = max(preset.lights[1] for preset in RANDOMIZATIONS.values())
    return draw_look(replace(RANDOMIZATIONS["none"], lights=(most, most)), count, rng)
