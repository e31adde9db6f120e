"""Another look for an existing scene: lamps, ambient light, colours, gloss and textures, not its poses."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import UInt8

from simpick.errors import SceneError
from simpick.scene.composition import material_name
from simpick.scene.lighting import SPECULAR, lamp_direction, lamp_name
from simpick.scene.randomization import Look
from simpick.scene.scene import Scene


def relight(scene: Scene, look: Look) -> None:
    """Give a scene another look; a renderer of it must then `upload_textures`. The camera's jitter is not applied.

    Raises:
        SceneError: the scene was composed with fewer lamps than the look has, or holds another number of parts.
    """
    model = scene.model
    if len(look.lamps) > model.nlight:
        raise SceneError(f"a look must have at most the scene's {model.nlight} lamps, got {len(look.lamps)}")
    if len(look.tints) != len(scene.instances):
        raise SceneError(f"a look must have a tint for each of {len(scene.instances)} parts, got {len(look.tints)}")
    model.light_active[:] = False
    for k, lamp in enumerate(look.lamps):
        light = model.light(lamp_name(k)).id
        model.light_active[light] = True
        model.light_pos[light] = lamp.position_m
        model.light_dir[light] = lamp_direction(lamp) / np.linalg.norm(lamp_direction(lamp))
        model.light_diffuse[light] = lamp.rgb
        model.light_specular[light] = SPECULAR * lamp.rgb
    model.vis.headlight.ambient[:] = look.ambient
    for instance, tint in zip(scene.instances, look.tints, strict=True):
        material = model.material(material_name(instance.instance)).id
        worn = tint.applied_to(instance.part.material)
        model.mat_rgba[material, :3] = worn.rgb
        model.mat_specular[material] = worn.specular
        model.mat_shininess[material] = worn.shininess
    _repaint(model, "table", look.table_texture)
    _repaint(model, "bin", look.bin_texture)
    scene.update_kinematics()


def _repaint(model: mujoco.MjModel, name: str, image: UInt8[np.ndarray, "size size 3"]) -> None:
    """Write an image into a texture of the same width, below itself until it is full (the six faces of a cube)."""
    texture = model.texture(name).id
    start, size = int(model.tex_adr[texture]), int(model.tex_height[texture] * model.tex_width[texture] * 3)
    model.tex_data[start : start + size] = np.tile(image.ravel(), size // image.size)
