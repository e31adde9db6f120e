"""Composition of a scene's MuJoCo specification from its parts: arena, lights, cameras, arm, gripper, instances."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from simpick.assets.mjcf import COLLISION_GROUP, add_material, add_part
from simpick.assets.part import Part
from simpick.assets.robots.registry import get_robot
from simpick.errors import SceneError
from simpick.scene.arena import add_arena
from simpick.scene.cameras import add_fixed_cameras
from simpick.scene.config import BinConfig, SceneConfig
from simpick.scene.lighting import add_lighting
from simpick.scene.parking import add_parking
from simpick.scene.physics import PhysicsConfig, apply_physics, set_part_contact
from simpick.scene.randomization import RANDOMIZATIONS, Look, PartTint, draw_look
from simpick.scene.robot import mount_robot
from simpick.scene.workspace import bin_zone

# Each use of randomness has its own stream, so that a change of looks does not change the physics.
_PARTS_STREAM, _LOOK_STREAM, _DROP_STREAM = 0, 1, 2

# Largest share of a pile's volume that the convex hulls of loosely poured parts can fill.
_PACKING = 0.65


def body_name(instance: int) -> str:
    """Return the name of an instance's body and free joint."""
    return f"part_{instance:02d}"


def material_name(instance: int) -> str:
    """Return the name of an instance's own material."""
    return f"{body_name(instance)}/material"


def draw_parts(pool: Sequence[Part], count: int, seed: int) -> tuple[Part, ...]:
    """Return the part of each instance, drawn from `pool` with equal chances."""
    rng = np.random.default_rng([seed, _PARTS_STREAM])
    return tuple(pool[k] for k in rng.integers(len(pool), size=count))


def drop_generator(seed: int) -> np.random.Generator:
    """Return the stream that decides how parts fall."""
    return np.random.default_rng([seed, _DROP_STREAM])


def check_fit(parts: Sequence[Part], bin: BinConfig) -> None:
    """Raise SceneError where a part is too large for the bin in any orientation."""
    room = np.sort([bin.length_m, bin.width_m, bin.depth_m])
    for part in parts:
        if np.any(np.sort(part.extents_m) > 0.95 * room):
            size = " x ".join(f"{1000 * side:.0f}" for side in sorted(part.extents_m, reverse=True))
            raise SceneError(
                f"part {part.name!r} ({size} mm) must fit into the bin"
                f" ({1000 * bin.length_m:.0f} x {1000 * bin.width_m:.0f} x {1000 * bin.depth_m:.0f} mm inside) with 5 %"
                " to spare; take a larger bin or check the unit of the part's file"
            )


def check_capacity(parts: Sequence[Part], bin: BinConfig) -> None:
    """Raise SceneError where this many parts do not fit into the bin even if packed well."""
    wanted = sum(part.mesh.convex_hull.volume for part in parts) / _PACKING
    room = float(np.prod(bin_zone(bin).size_m))
    if wanted > room:
        raise SceneError(
            f"{len(parts)} parts ({', '.join(sorted({part.name for part in parts}))}) must fit into the bin with its"
            f" heap ({1000 * room:.1f} litres), got parts that fill {1000 * wanted:.1f} litres when heaped; take"
            f" at most {int(len(parts) * room / wanted)} parts or a larger bin"
        )


def compose_scene(config: SceneConfig, parts: Sequence[Part], seed: int) -> mujoco.MjSpec:
    """Return the whole cell: arena, lights, cameras, robot, and every instance's body at the world's origin."""
    look = draw_look(RANDOMIZATIONS[config.randomization], len(parts), np.random.default_rng([seed, _LOOK_STREAM]))
    return compose_with_look(config, parts, look)


def compose_with_look(config: SceneConfig, parts: Sequence[Part], look: Look) -> mujoco.MjSpec:
    """Return the whole cell as `compose_scene` does, with a given look; ``config.randomization`` is not read."""
    spec = _compose_cell(config, look)
    add_lighting(spec, look)
    add_fixed_cameras(spec, config, look.T_camera_jittered)
    if config.robot is not None:
        mount_robot(spec, get_robot(config.robot), config)
    for k, (part, tint) in enumerate(zip(parts, look.tints, strict=True)):
        _add_instance(spec, part, k, config.physics, tint)
    return spec


def compose_settling(config: SceneConfig, parts: Sequence[Part]) -> mujoco.MjSpec:
    """Return the cell without arm, cameras and looks, into which parts are dropped."""
    plain = draw_look(RANDOMIZATIONS["none"], len(parts), np.random.default_rng(0))
    spec = _compose_cell(config, plain)
    for k, part in enumerate(parts):
        _add_instance(spec, part, k, config.physics, None)
    return spec


def _compose_cell(config: SceneConfig, look: Look) -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.modelname = "simpick"
    spec.compiler.degree = False
    apply_physics(spec, config.physics)
    # Fifty parts in a pile make a few thousand contact rows; the default arena would overflow.
    spec.memory = 256 * 2**20
    add_arena(spec, config.bin, config.physics, look.table_texture, look.bin_texture)
    return spec


def _add_instance(
    spec: mujoco.MjSpec, part: Part, instance: int, physics: PhysicsConfig, tint: PartTint | None
) -> None:
    name = body_name(instance)
    material = None
    if tint is not None:
        look = tint.applied_to(part.material)
        material = material_name(instance)
        add_material(spec, material, look)
    body = add_part(spec, part, name, material=material)
    for geom in body.geoms:
        if geom.group == COLLISION_GROUP:
            set_part_contact(geom, physics)
    add_parking(spec, name, instance)
