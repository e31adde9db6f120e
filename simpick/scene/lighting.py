"""Lamps, ambient light and the costs of rendering them."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.scene.randomization import Lamp, Look
from simpick.scene.workspace import BIN_CENTRE_M

SHADOW_MAP_PX = 1024
"""Side of the shadow map: MuJoCo's default of 4096 costs four times as much on a software renderer."""
SAMPLES_PER_PIXEL = 2
"""Anti-aliasing samples."""
SPECULAR = 0.5
"""Share of a lamp's light that highlights get."""


def lamp_name(k: int) -> str:
    """Return the name of the look's k-th lamp."""
    return f"lamp_{k}"


def lamp_direction(lamp: Lamp) -> Float[np.ndarray, "3"]:
    """Return the vector from the lamp to the bin."""
    return np.array(BIN_CENTRE_M) - lamp.position_m


def add_lighting(spec: mujoco.MjSpec, look: Look) -> None:
    """Add the lamps of `look`, which aim at the bin, and set ambient light and quality."""
    spec.visual.quality.shadowsize = SHADOW_MAP_PX
    spec.visual.quality.offsamples = SAMPLES_PER_PIXEL
    # The clipping planes scale with the extent, so both are fixed: 3 cm (the wrist camera sees its own hand) to 6 m.
    spec.stat.extent = 1.0
    spec.stat.center = [*BIN_CENTRE_M[:2], 0.1]
    spec.visual.map.znear = 0.03
    spec.visual.map.zfar = 6.0
    # The head light sits at the camera and would flatten every shape; only its ambient part is used.
    spec.visual.headlight.diffuse = [0.0, 0.0, 0.0]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.headlight.ambient = [look.ambient] * 3
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        width=64, height=64 * 6, rgb1=[0.62, 0.65, 0.68], rgb2=[0.30, 0.31, 0.33],
    )  # fmt: skip
    for k, lamp in enumerate(look.lamps):
        light = spec.worldbody.add_light(name=lamp_name(k), pos=lamp.position_m)
        light.dir = lamp_direction(lamp)
        light.type = mujoco.mjtLightType.mjLIGHT_SPOT
        # The lamp with shadows is narrow, which makes the most of its shadow map; it still lights the whole cell.
        light.cutoff = 36.0 if lamp.casts_shadow else 60.0
        light.exponent = 2.0
        light.diffuse = lamp.rgb
        light.specular = SPECULAR * lamp.rgb
        light.ambient = [0.0, 0.0, 0.0]
        light.castshadow = lamp.casts_shadow
