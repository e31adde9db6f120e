"""`build_scene`: from a configuration and a seed to a filled bin."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.errors import ConfigError
from simpick.geometry.transforms import matrix_from_quaternion, transform
from simpick.scene.composition import (
    check_capacity,
    check_fit,
    compose_scene,
    compose_with_look,
    draw_parts,
    drop_generator,
)
from simpick.scene.config import SceneConfig
from simpick.scene.randomization import Look
from simpick.scene.scene import Scene
from simpick.scene.settling import settle


def build_scene(config: SceneConfig, seed: int) -> Scene:
    """Return a scene whose parts lie still in the bin, with the arm at home; the seed determines all of it.

    Raises UnknownPartError, MeshError and SceneError (a part larger than the bin, parts that do not stay in it)
    before or while it fills the bin.
    """
    if seed < 0:
        raise ConfigError(f"seed must not be negative, got {seed}")
    pool = tuple(get_part(name) for name in config.parts)
    check_fit(pool, config.bin)
    parts = draw_parts(pool, config.count, seed)
    check_capacity(parts, config.bin)
    return _filled(config, seed, parts, compose_scene(config, parts, seed))


def build_scene_of(
    config: SceneConfig, parts: Sequence[Part], seed: int, look: Look, *, aligned: bool = False
) -> Scene:
    """Return a settled scene of exactly these instances in this look; the seed decides how they fall.

    With `aligned`, they fall nearly in a common orientation (see `settle`).

    For data made in bulk: what `config` says of parts, count and randomization is not read, and such a scene cannot
    be loaded once saved. Raises SceneError as `build_scene` does.
    """
    check_fit(list({part.name: part for part in parts}.values()), config.bin)
    check_capacity(parts, config.bin)
    return _filled(config, seed, parts, compose_with_look(config, parts, look), aligned=aligned)


def _filled(
    config: SceneConfig, seed: int, parts: Sequence[Part], spec: mujoco.MjSpec, *, aligned: bool = False
) -> Scene:
    settled = settle(config, parts, drop_generator(seed), aligned=aligned)
    scene = Scene(config, seed, parts, spec.compile())
    scene.redropped = settled.redropped
    scene.go_home()
    Ts_world_part = transform(matrix_from_quaternion(settled.qpos[:, 3:]), settled.qpos[:, :3])
    scene.place(dict(enumerate(Ts_world_part)))
    return scene
