"""Template sets: views of a part from all around, rendered once and cached on disk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
from annotated_types import Interval
from jaxtyping import Bool, Float, Float32, Int, UInt8, UInt16

from simpick.assets.part import Part
from simpick.caching import cache_dir, cache_key, cache_name, cached_arrays
from simpick.config import Config
from simpick.errors import ConfigError
from simpick.geometry import Pinhole
from simpick.rendering.mujoco_presence import required_mujoco
from simpick.rendering.quality import PART_QUALITY
from simpick.rendering.view_sphere import VIEW_COUNTS, look_at_part, turn_in_plane, view_directions

# Raise when the same configuration would give other images.
_VERSION = 2
_DEPTH_STEPS = 65534

_noted_versions: dict[str, str] = {}
"""MuJoCo's version that rendered the templates of a part, by the part's hash: see `note_rendering_version`."""


@dataclass(frozen=True)
class TemplateConfig(Config):
    """Which views of a part are rendered."""

    views: int = 162
    """Directions on the view sphere: 12, 42, 162, 642 or 2562 (162: at most 11 degrees to the nearest view)."""
    size_px: Annotated[int, Interval(ge=16, le=1024)] = 128
    """Width and height of each image."""
    distance_diameters: Annotated[float, Interval(ge=1, le=1000)] = 10.0
    """Distance of the camera in diameters of the part, which sets the perspective."""
    fill: Annotated[float, Interval(ge=0.1, le=1)] = 0.95
    """Share of the image's width that the part's bounding sphere spans."""

    def _check_rules(self) -> None:
        if self.views not in VIEW_COUNTS:
            raise ConfigError(f"views must be one of {', '.join(map(str, VIEW_COUNTS))}, got {self.views}")

    def camera(self, part: Part) -> Pinhole:
        """Return the camera of all templates of a part."""
        radius = float(np.linalg.norm(part.mesh.vertices, axis=-1).max())
        # The sphere's outline as seen from the camera is wider than its radius at the centre's distance.
        tangent = np.tan(np.arcsin(radius / self.distance_m(part)))
        focal = self.fill * self.size_px / 2 / float(tangent)
        return Pinhole(self.size_px, self.size_px, focal, focal, self.size_px / 2, self.size_px / 2)

    def distance_m(self, part: Part) -> float:
        """Return the distance from the camera to the part's origin."""
        return self.distance_diameters * part.diameter_m


@dataclass(frozen=True, eq=False)
class TemplateSet:
    """Views of one part. Its origin is at the images' centre; light comes from the camera only."""

    part: str
    camera: Pinhole
    """Of every view."""
    Ts_camera_part: Float[np.ndarray, "views 4 4"]
    rgb: UInt8[np.ndarray, "views size size 3"]
    """Black where the part is not."""
    depth_m: Float32[np.ndarray, "views size size"]
    """Distance along the optical axis; 0 where the part is not."""

    def __len__(self) -> int:
        return len(self.Ts_camera_part)

    @cached_property
    def masks(self) -> Bool[np.ndarray, "views size size"]:
        """Return the silhouettes."""
        return self.depth_m > 0

    def turned(
        self, views: Int[np.ndarray, "n"], angles_rad: Float[np.ndarray, "n"]
    ) -> tuple[UInt8[np.ndarray, "n size size 3"], Bool[np.ndarray, "n size size"], Float[np.ndarray, "n 4 4"]]:
        """Return images, silhouettes and T_camera_part of views turned clockwise about the image's centre.

        Exact but for resampling, because the light turns with the camera.
        """
        size = self.camera.width
        rgb = np.empty((len(views), size, size, 3), np.uint8)
        masks = np.empty((len(views), size, size), bool)
        for k, (view, angle) in enumerate(zip(views, angles_rad, strict=True)):
            # OpenCV turns counter-clockwise and puts pixel centres at integers.
            warp = cv2.getRotationMatrix2D(((size - 1) / 2, (size - 1) / 2), -np.degrees(angle), 1.0)
            rgb[k] = cv2.warpAffine(self.rgb[view], warp, (size, size), flags=cv2.INTER_LINEAR)
            mask = 255 * self.masks[view].astype(np.uint8)
            masks[k] = cv2.warpAffine(mask, warp, (size, size), flags=cv2.INTER_LINEAR) > 127
        return rgb, masks, turn_in_plane(self.Ts_camera_part[views], angles_rad)


def load_templates(
    part: Part, config: TemplateConfig | None = None, *, progress: Callable[[int, int], None] | None = None
) -> TemplateSet:
    """Return a part's templates from the cache, or render and keep them.

    Any number of processes may ask at once; a damaged file is made again. `progress` is called with how many of how
    many views are rendered, and not at all if they come from the cache.
    """
    config = config or TemplateConfig()

    def render() -> dict[str, np.ndarray]:
        rendered = render_templates(part, config, progress=progress)
        steps = steps_from_depth(rendered.depth_m, rendered.Ts_camera_part, rendered.camera)
        return {"rgb": rendered.rgb, "depth": steps}

    arrays = cached_arrays(template_path(part, config), ("rgb", "depth"), render)
    camera, Ts_camera_part = config.camera(part), look_at_part(view_directions(config.views), config.distance_m(part))
    shape = (config.views, config.size_px, config.size_px)
    # Files of simpick 0.1 hold plain bytes.
    steps = arrays["depth"].view("<u2").reshape(shape)
    depth_m = depth_from_steps(steps, Ts_camera_part, camera)
    return TemplateSet(part.name, camera, Ts_camera_part, arrays["rgb"].reshape(*shape, 3), depth_m)


def render_templates(
    part: Part, config: TemplateConfig | None = None, *, progress: Callable[[int, int], None] | None = None
) -> TemplateSet:
    """Return newly rendered templates and leave the cache alone.

    Raises:
        RenderingUnavailableError: MuJoCo or OpenGL is missing.
    """
    _required_mujoco(part)
    # Only here, because templates from the cache need no MuJoCo.
    from simpick.rendering.part_views import PartRenderer

    config = config or TemplateConfig()
    camera = config.camera(part)
    Ts_camera_part = look_at_part(view_directions(config.views), config.distance_m(part))
    with PartRenderer(part, camera.height, camera.width) as renderer:
        views = renderer.render(Ts_camera_part, camera, progress=progress)
    assert views.rgb is not None
    # Rounded as the file rounds it, so that the first run and the next see the same bits.
    depth_m = depth_from_steps(steps_from_depth(views.depth_m, Ts_camera_part, camera), Ts_camera_part, camera)
    return TemplateSet(part.name, camera, Ts_camera_part, views.rgb, depth_m)


def template_path(part: Part, config: TemplateConfig) -> Path:
    """Return where the templates of a part are kept."""
    key = cache_key(_VERSION, part.content_hash, repr(config), repr(PART_QUALITY), rendering_version(part))
    return cache_dir() / "templates" / cache_name(part.name, key, ".zip")


def rendering_version(part: Part) -> str:
    """Return the version of MuJoCo that templates of a part are of: the one that was noted, else the installed one.

    Raises:
        RenderingUnavailableError: no version was noted, and MuJoCo cannot be imported.
    """
    return _noted_versions.get(part.content_hash) or _required_mujoco(part)


def note_rendering_version(part: Part, version: str) -> None:
    """Note the version of MuJoCo that rendered the templates of a part elsewhere, where none is installed."""
    _noted_versions[part.content_hash] = version


def _required_mujoco(part: Part) -> str:
    elsewhere = "simpick parts onboard PART --mode MODE --out FILE.simpick"
    otherwise = f". Or onboard the part for this mode on another machine: {elsewhere}"
    return required_mujoco(f"rendering templates of {part.name}", otherwise)


def steps_from_depth(
    depth_m: Float32[np.ndarray, "views size size"], Ts_camera_part: Float[np.ndarray, "views 4 4"], camera: Pinhole
) -> UInt16[np.ndarray, "views size size"]:
    """Return templates' depth as 16-bit steps of a micrometre or so through the bounding sphere; 0 remains 0."""
    near, step = _depth_scale(Ts_camera_part, camera)
    return np.where(depth_m > 0, 1.5 + (depth_m - near) / step, 0).astype(np.uint16)


def depth_from_steps(
    steps: UInt16[np.ndarray, "views size size"], Ts_camera_part: Float[np.ndarray, "views 4 4"], camera: Pinhole
) -> Float32[np.ndarray, "views size size"]:
    """Return the depth in metres that `steps_from_depth` was given, rounded."""
    near, step = _depth_scale(Ts_camera_part, camera)
    return np.where(steps > 0, np.float32(near - step) + steps * np.float32(step), np.float32(0))


def _depth_scale(Ts_camera_part: Float[np.ndarray, "views 4 4"], camera: Pinhole) -> tuple[np.float32, np.float32]:
    """Return the depth of the first step and the step's length."""
    distance = float(Ts_camera_part[0, 2, 3])
    # The bounding sphere is inside the image, so its radius is less than the half width at its centre.
    radius = distance * camera.width / 2 / camera.fx
    return np.float32(distance - radius), np.float32(2 * radius / _DEPTH_STEPS)
