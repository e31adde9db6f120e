"""Variation of the look of a scene with the seed, and the look of one seed.

Looks never touch the physics: the same seed drops the same parts into the same places under every preset.
"""

from __future__ import annotations

import colorsys
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, UInt8

from simpick.assets.part import Material
from simpick.geometry.transforms import random_rotation, so3_exp, so3_log, transform
from simpick.scene.textures import PATTERNS


@dataclass(frozen=True)
class Randomization:
    """Ranges that a look is drawn from."""

    lights: tuple[int, int] = (2, 2)
    """Fewest and most lamps besides the ambient light."""
    light_spread_m: float = 0.0
    """Half side of the square in which each lamp is moved about its place; in height by half as much."""
    light_intensity: tuple[float, float] = (1.0, 1.0)
    """Factor on the brightness of all lamps."""
    light_tint: float = 0.0
    """Largest relative change of each lamp's red, green and blue."""
    ambient: tuple[float, float] = (0.27, 0.27)
    """Brightness of the ambient light."""
    part_hue: float = 0.0
    """Largest change of a part's hue, in turns; every instance has its own."""
    part_value: float = 0.0
    """Largest relative change of a part's brightness."""
    part_gloss: float = 0.0
    """Largest change of specular and shininess."""
    patterns: tuple[str, ...] = ("mottled",)
    """Textures of floor and bin, by their names in `textures.PATTERNS`."""
    texture_contrast: tuple[float, float] = (0.06, 0.06)
    """Relative change of brightness within a texture."""
    table_rgb: tuple[tuple[float, float, float], ...] = ((0.42, 0.43, 0.44),)
    """Colours that the table may have."""
    bin_rgb: tuple[tuple[float, float, float], ...] = ((0.23, 0.30, 0.42),)
    """Colours that the bin may have."""
    colour_jitter: float = 0.0
    """Largest change of the red, green and blue of table and bin."""
    camera_shift_m: float = 0.0
    """Largest distance of the overhead camera from its place, along each axis."""
    camera_turn_deg: float = 0.0
    """Largest rotation of the overhead camera from its direction."""


_GREYS_AND_WOODS = ((0.36, 0.37, 0.38), (0.55, 0.55, 0.54), (0.20, 0.21, 0.22), (0.46, 0.36, 0.26))
_BIN_COLOURS = ((0.23, 0.30, 0.42), (0.30, 0.31, 0.33), (0.45, 0.46, 0.47), (0.42, 0.18, 0.15), (0.16, 0.17, 0.18))

RANDOMIZATIONS: dict[str, Randomization] = {
    "none": Randomization(),
    "default": Randomization(
        lights=(2, 3),
        light_spread_m=0.15,
        light_intensity=(0.85, 1.15),
        light_tint=0.04,
        ambient=(0.22, 0.31),
        part_hue=0.01,
        part_value=0.08,
        part_gloss=0.1,
        texture_contrast=(0.03, 0.10),
        colour_jitter=0.03,
        camera_shift_m=0.005,
        camera_turn_deg=0.5,
    ),
    "strong": Randomization(
        lights=(1, 4),
        light_spread_m=0.6,
        light_intensity=(0.6, 1.35),
        light_tint=0.15,
        ambient=(0.12, 0.38),
        part_hue=0.5,
        part_value=0.4,
        part_gloss=0.4,
        patterns=("mottled", "brushed", "checkered"),
        texture_contrast=(0.0, 0.35),
        table_rgb=_GREYS_AND_WOODS,
        bin_rgb=_BIN_COLOURS,
        colour_jitter=0.12,
        camera_shift_m=0.03,
        camera_turn_deg=3.0,
    ),
    # One lamp that casts hard shadows, alone or nearly, from any side or from above.
    "photo": Randomization(
        lights=(1, 2),
        light_spread_m=1.0,
        light_intensity=(0.9, 1.7),
        light_tint=0.2,
        ambient=(0.08, 0.30),
        part_hue=0.5,
        part_value=0.4,
        part_gloss=0.6,
        patterns=("mottled", "brushed", "checkered"),
        texture_contrast=(0.05, 0.4),
        table_rgb=_GREYS_AND_WOODS,
        bin_rgb=_BIN_COLOURS,
        colour_jitter=0.15,
        camera_shift_m=0.03,
        camera_turn_deg=3.0,
    ),
}
"""Presets by name."""


@dataclass(frozen=True, eq=False)
class Lamp:
    """One spot light that aims at the bin."""

    position_m: Float[np.ndarray, "3"]
    rgb: Float[np.ndarray, "3"]
    casts_shadow: bool


@dataclass(frozen=True, eq=False)
class PartTint:
    """How one instance's material differs from its part's."""

    hue_turns: float
    value_factor: float
    gloss: float

    def recolour(self, rgb: tuple[float, float, float]) -> tuple[float, float, float]:
        """Return `rgb` in [0, 1] with hue and brightness changed."""
        hue, saturation, value = colorsys.rgb_to_hsv(*rgb)
        if abs(self.hue_turns) > 0.1:
            # A grey part has no hue to shift: strong changes also give it some colour.
            saturation = max(saturation, min(1.0, abs(self.hue_turns)))
        return colorsys.hsv_to_rgb((hue + self.hue_turns) % 1.0, saturation, min(value * self.value_factor, 1.0))

    def applied_to(self, material: Material) -> Material:
        """Return a part's material with this instance's variation."""
        return replace(
            material,
            rgb=self.recolour(material.rgb),
            specular=float(np.clip(material.specular + self.gloss, 0, 1)),
            shininess=float(np.clip(material.shininess + self.gloss, 0, 1)),
        )


@dataclass(frozen=True, eq=False)
class Look:
    """Everything visible that is drawn at random, drawn."""

    lamps: tuple[Lamp, ...]
    ambient: float
    tints: tuple[PartTint, ...]
    table_texture: UInt8[np.ndarray, "size size 3"]
    bin_texture: UInt8[np.ndarray, "size size 3"]
    T_camera_jittered: Float[np.ndarray, "4 4"]
    """Leads from the jittered overhead camera to its nominal frame."""


# Places of the lamps (m): the first casts the shadows, from above the bin's far side, as in a lit workshop.
_LAMP_PLACES = ((0.75, 0.45, 1.9), (0.15, -0.65, 1.7), (1.05, -0.35, 1.8), (0.20, 0.75, 1.8))
_LAMP_STRENGTHS = (0.50, 0.27, 0.22, 0.22)


def draw_look(randomization: Randomization, count: int, rng: np.random.Generator) -> Look:
    """Return the look of a scene with `count` part instances."""
    lamps = []
    intensity = rng.uniform(*randomization.light_intensity)
    # One lamp alone must give the light of two.
    number = int(rng.integers(randomization.lights[0], randomization.lights[1] + 1))
    total = sum(_LAMP_STRENGTHS[:2]) / sum(_LAMP_STRENGTHS[:number])
    for k in range(number):
        shift = rng.uniform(-1, 1, 3) * randomization.light_spread_m * np.array([1, 1, 0.5])
        tint = 1 + rng.uniform(-1, 1, 3) * randomization.light_tint
        rgb = np.clip(_LAMP_STRENGTHS[k] * total * intensity * tint, 0, 1)
        lamps.append(Lamp(np.array(_LAMP_PLACES[k]) + shift, rgb, casts_shadow=k == 0))
    ambient = float(rng.uniform(*randomization.ambient))

    tints = tuple(
        PartTint(
            float(rng.uniform(-1, 1) * randomization.part_hue),
            float(1 + rng.uniform(-1, 1) * randomization.part_value),
            float(rng.uniform(-1, 1) * randomization.part_gloss),
        )
        for _ in range(count)
    )
    table = _draw_texture(randomization, randomization.table_rgb, rng)
    bin_ = _draw_texture(randomization, randomization.bin_rgb, rng)

    shift = rng.uniform(-1, 1, 3) * randomization.camera_shift_m
    axis = so3_log(random_rotation(rng))
    turn = axis / max(float(np.linalg.norm(axis)), 1e-9) * np.radians(rng.uniform(0, 1) * randomization.camera_turn_deg)
    return Look(tuple(lamps), ambient, tints, table, bin_, transform(so3_exp(turn), shift))


def _draw_texture(
    randomization: Randomization, colours: tuple[tuple[float, float, float], ...], rng: np.random.Generator
) -> UInt8[np.ndarray, "size size 3"]:
    pattern = PATTERNS[randomization.patterns[rng.integers(len(randomization.patterns))]]
    rgb = np.array(colours[rng.integers(len(colours))])
    rgb = np.clip(rgb + rng.uniform(-1, 1, 3) * randomization.colour_jitter, 0.02, 0.95)
    return pattern(rng, rgb, float(rng.uniform(*randomization.texture_contrast)))
