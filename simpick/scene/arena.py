"""The contents of the cell besides robot and parts: table, bin and chute."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import UInt8

from simpick.scene.config import BinConfig
from simpick.scene.physics import PhysicsConfig, set_part_contact
from simpick.scene.workspace import BIN_CENTRE_M, CHUTE, CHUTE_CENTRE_M, TABLE_Z_M

ARENA_GROUP = 1
"""Geoms of table, bin and chute: visible to cameras and solid."""
_TABLE_HALF_SIDE_M = 1.6


def add_arena(
    spec: mujoco.MjSpec,
    bin: BinConfig,
    physics: PhysicsConfig,
    table_texture: UInt8[np.ndarray, "size size 3"],
    bin_texture: UInt8[np.ndarray, "size size 3"],
) -> None:
    """Add the table, the bin (body ``bin``) and the chute (body ``chute``)."""
    _add_material(spec, "table", table_texture, mujoco.mjtTexture.mjTEXTURE_2D, repeat=4.0, specular=0.1)
    _add_material(spec, "bin", bin_texture, mujoco.mjtTexture.mjTEXTURE_CUBE, repeat=1.0, specular=0.25)
    spec.add_material(name="chute", rgba=[0.42, 0.40, 0.36, 1.0], specular=0.2, shininess=0.3)

    table = spec.worldbody.add_geom(
        name="table", type=mujoco.mjtGeom.mjGEOM_PLANE, material="table", group=ARENA_GROUP,
        pos=[0.4, 0.0, TABLE_Z_M], size=[_TABLE_HALF_SIDE_M, _TABLE_HALF_SIDE_M, 0.1],
    )  # fmt: skip
    set_part_contact(table, physics)

    _add_container(spec, "bin", BIN_CENTRE_M, bin, physics)
    _add_container(spec, "chute", CHUTE_CENTRE_M, CHUTE, physics)


def _add_container(
    spec: mujoco.MjSpec, name: str, centre: tuple[float, float, float], size: BinConfig, physics: PhysicsConfig
) -> None:
    """Add an open box of five boxes; its body's origin is the centre of its inner floor."""
    body = spec.worldbody.add_body(name=name, pos=centre)
    half_x, half_y, depth, wall = size.width_m / 2, size.length_m / 2, size.depth_m, size.wall_m
    # The walls stand on the outer floor plate and the long ones take the corners, so that no faces coincide.
    boxes = {
        "floor": ((0, 0, -wall / 2), (half_x + wall, half_y + wall, wall / 2)),
        "wall_near": ((-half_x - wall / 2, 0, depth / 2), (wall / 2, half_y + wall, depth / 2)),
        "wall_far": ((half_x + wall / 2, 0, depth / 2), (wall / 2, half_y + wall, depth / 2)),
        "wall_right": ((0, -half_y - wall / 2, depth / 2), (half_x, wall / 2, depth / 2)),
        "wall_left": ((0, half_y + wall / 2, depth / 2), (half_x, wall / 2, depth / 2)),
    }
    for part, (position, half_sides) in boxes.items():
        geom = body.add_geom(
            name=f"{name}/{part}", type=mujoco.mjtGeom.mjGEOM_BOX, material=name, group=ARENA_GROUP,
            pos=position, size=half_sides,
        )  # fmt: skip
        set_part_contact(geom, physics)


def _add_material(
    spec: mujoco.MjSpec,
    name: str,
    image: UInt8[np.ndarray, "size size 3"],
    kind: mujoco.mjtTexture,
    repeat: float,
    specular: float,
) -> None:
    texture = spec.add_texture(name=name, type=kind, width=image.shape[1], height=image.shape[0], nchannel=3)
    if kind == mujoco.mjtTexture.mjTEXTURE_CUBE:
        # A cube texture holds six faces below each other; a bin has the same image on all of them.
        texture.height = 6 * image.shape[0]
        image = np.concatenate([image] * 6)
    texture.data = image.tobytes()
    material = spec.add_material(name=name, specular=specular, shininess=0.3, texrepeat=[repeat, repeat])
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
