"""Images of random bins with instance masks: what the detector is trained on. Each bin follows from its index."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from annotated_types import Interval
from jaxtyping import Float, UInt8

from simpick.assets.random_curves import random_curve
from simpick.assets.random_parts import random_part
from simpick.config import Config, Fraction, NonNegativeInt, PositiveInt
from simpick.errors import ConfigError
from simpick.geometry import Pinhole, look_at, so3_exp, transform
from simpick.rendering import SceneRenderer, Viewpoint, measure_instance
from simpick.scene import Scene
from simpick.scene.config import MAX_PARTS
from simpick.scene.randomization import RANDOMIZATIONS, Look, draw_look
from simpick.scene.relighting import relight
from simpick.scene.workspace import BIN_CENTRE_M
from simpick.training.data.data_config import DataConfig, Split
from simpick.training.data.random_bins import random_bin, random_part_seed

VERSION = 2
"""Raised when the same configuration would give other images."""
_BINS_PER_POOL = 20
"""Bins in a row whose other parts come from one pool: making a part costs as much as dropping it."""
_AIM_M = 0.03
"""Largest distance of the point that a camera looks at from the bin's centre, along x and y."""

_Count = Annotated[int, Interval(ge=1, le=MAX_PARTS)]
_Height = Annotated[float, Interval(ge=0.4, le=3)]
_Fovy = Annotated[float, Interval(ge=5, le=120)]
_Pixels = Annotated[int, Interval(ge=64, le=4096)]


@dataclass(frozen=True)
class BinDataConfig(Config):
    """Ranges that bins and views are drawn from. Together with a split and an index it determines a bin's images."""

    seed: NonNegativeInt = 0
    """Another seed gives other parts, bins and views."""
    views: PositiveInt = 5
    """Images per settled bin, each in another light, with other colours, from another place."""
    count: tuple[_Count, _Count] = (5, 50)
    """Fewest and most parts in a bin."""
    curved: bool = False
    """Whether the part that a homogeneous bin holds, or that others are mixed with, is a bent one."""
    homogeneous_share: Fraction = 0.45
    """Share of bins that hold one part only."""
    aligned_share: Fraction = 0.4
    """Share of bins whose parts fall nearly in a common orientation, so that many lie flush on one another."""
    crowd_share: Fraction = 0.35
    """Share of bins that hold many kinds of parts; the rest hold two to four."""
    height_m: tuple[_Height, _Height] = (0.75, 1.05)
    """Height of the camera over the bin's floor."""
    fovy_deg: tuple[_Fovy, _Fovy] = (26.0, 31.0)
    """Vertical field of view."""
    tilt_deg: Annotated[float, Interval(ge=0, le=80)] = 10.0
    """Largest angle between the optical axis and the vertical."""
    strong_share: Fraction = 0.3
    """Share of views in the look `strong`."""
    photo_share: Fraction = 0.35
    """Share of views in the look `photo`; what is left has the look `default`."""
    one_tint_share: Fraction = 0.5
    """Share of views in which equal parts have equal colours, whatever the look."""
    width_px: _Pixels = 640
    """Image width."""
    height_px: _Pixels = 480
    """Image height."""

    def _check_rules(self) -> None:
        for first, second in (("homogeneous_share", "crowd_share"), ("strong_share", "photo_share")):
            shares = getattr(self, first), getattr(self, second)
            if sum(shares) > 1:
                raise ConfigError(f"{first} and {second} must not exceed 1 in sum, got {shares[0]} and {shares[1]}")


@dataclass(frozen=True, eq=False)
class BinImage:
    """One view of a random bin."""

    rgb: UInt8[np.ndarray, "height width 3"]
    ids: UInt8[np.ndarray, "height width"]
    """Number of the instance in each pixel, from 1; 0 is background."""
    fractions: Float[np.ndarray, "instances"] | None
    """Visible share of the silhouette of instance k + 1, 0 where it is not seen; None in training, which needs none."""


def make_bin(config: BinDataConfig, index: int, split: Split) -> list[BinImage]:
    """Return the views of the bin of this index, the same in every process.

    Raises:
        ConfigError: the index is negative.
        SceneError: no bin came to rest.
    """
    if index < 0:
        raise ConfigError(f"index of a bin must not be negative, got {index}")
    rng = np.random.default_rng([config.seed, split == "validation", 15, index])
    scene = _scene(config, index, rng, split)
    images = []
    with SceneRenderer(scene) as renderer:
        for _ in range(config.views):
            relight(scene, _look(config, len(scene.instances), rng))
            renderer.renderer.upload_textures()
            images.append(_capture(renderer, _viewpoint(config, rng), measured=split == "validation"))
    return images


def _look(config: BinDataConfig, count: int, rng: np.random.Generator) -> Look:
    kind = rng.random()
    photo = config.strong_share + config.photo_share
    preset = "strong" if kind < config.strong_share else "photo" if kind < photo else "default"
    look = draw_look(RANDOMIZATIONS[preset], count, rng)
    return replace(look, tints=look.tints[:1] * count) if rng.random() < config.one_tint_share else look


def _scene(config: BinDataConfig, index: int, rng: np.random.Generator, split: Split) -> Scene:
    base = DataConfig(
        seed=config.seed * 100_003 + index // _BINS_PER_POOL,
        count=config.count,
        bin_scale=(0.7, 1.0),
        image_width_px=config.width_px,
        image_height_px=config.height_px,
    )
    kind = rng.random()
    if kind < config.homogeneous_share:
        drawn = replace(base, mixed_share=0.0)
    elif kind < config.homogeneous_share + config.crowd_share:
        drawn = replace(base, mixed_share=1.0, others=(6, 20), target_share=(0.05, 0.2))
    else:
        drawn = replace(base, mixed_share=1.0, others=(1, 3), target_share=(0.3, 0.7))
    seed = random_part_seed(rng, split)
    part = random_curve(seed) if config.curved else random_part(seed)
    return random_bin(drawn, part, rng, split, aligned=rng.random() < config.aligned_share)


def _viewpoint(config: BinDataConfig, rng: np.random.Generator) -> Viewpoint:
    camera = Pinhole.from_fovy(config.width_px, config.height_px, float(rng.uniform(*config.fovy_deg)))
    tilt, azimuth, roll = np.radians(config.tilt_deg) * np.sqrt(rng.random()), *rng.uniform(0, 2 * np.pi, size=2)
    direction = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    aim = np.array(BIN_CENTRE_M) + np.append(rng.uniform(-_AIM_M, _AIM_M, size=2), 0.0)
    eye = aim + rng.uniform(*config.height_m) * direction
    # Half of the views stand as the bin does, the others are rolled by any angle.
    roll = roll if rng.random() < 0.5 else 0.0
    return Viewpoint(camera, look_at(eye, aim) @ transform(so3_exp(roll * np.array([0.0, 0.0, 1.0]))))


def _capture(renderer: SceneRenderer, viewpoint: Viewpoint, measured: bool) -> BinImage:
    frame = renderer.capture(viewpoint, depth=False)
    assert frame.instances is not None
    ids = (frame.instances + 1).astype(np.uint8)
    if not measured:
        return BinImage(frame.rgb, ids, None)
    count = int(renderer.scene.instance_of_geom.max()) + 1
    seen = np.bincount(frame.instances[frame.instances >= 0], minlength=count)
    fractions = np.zeros(count, np.float32)
    for k in np.flatnonzero(seen):
        instance = measure_instance(renderer, int(k), int(seen[k]), frame.camera, frame.T_world_camera)
        fractions[k] = instance.fraction if instance is not None else 0.0
    return BinImage(frame.rgb, ids, fractions)
