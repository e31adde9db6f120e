"""`build_scene`: from a configuration and a seed to a filled bin."""

from __future__ import annotations

from simpick.assets.library import get_part
from simpick.errors import ConfigError
from simpick.geometry.transforms import matrix_from_quaternion, transform
from simpick.scene.composition import check_capacity, check_fit, compose_scene, draw_parts, drop_generator
from simpick.scene.config import SceneConfig
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
    settled = settle(config, parts, drop_generator(seed))
    scene = Scene(config, seed, parts, compose_scene(config, parts, seed).compile())
    scene.redropped = settled.redropped
    scene.go_home()
    Ts_world_part = transform(matrix_from_quaternion(settled.qpos[:, 3:]), settled.qpos[:, :3])
    scene.place(dict(enumerate(Ts_world_part)))
    return scene
