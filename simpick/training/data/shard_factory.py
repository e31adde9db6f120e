"""`make_shard`: the training shard of a configuration, a split and an index."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float16, Float32, Int, UInt8

from simpick.assets.part import Part
from simpick.assets.random_parts import random_part
from simpick.errors import ConfigError
from simpick.geometry import CropBatch, Pinhole, crop_images, invert
from simpick.geometry.image_boxes import box_of_mask
from simpick.rendering import SceneRenderer, Viewpoint, Visibility, measure_instance, render_templates
from simpick.rendering.camera_effects import apply_camera_effects
from simpick.scene import Scene
from simpick.scene.relighting import relight
from simpick.training.data.bin_views import draw_view_look, draw_viewpoint
from simpick.training.data.data_config import DataConfig, Split
from simpick.training.data.random_bins import random_bin, random_part_seed
from simpick.training.data.shard import OWN, Shard

VERSION = 2
"""To be raised when the same configuration gives other shards."""
_BINS = 5


@dataclass(frozen=True, eq=False)
class _Query:
    rgb: UInt8[np.ndarray, "size size 3"]
    labels: UInt8[np.ndarray, "size size"]
    relief: Float16[np.ndarray, "size size"]
    focal_px: float
    T_crop_part: Float[np.ndarray, "4 4"]
    visible_fraction: float
    source_side_px: float
    view: int
    instance: int


def make_shard(config: DataConfig, index: int, *, split: Split) -> Shard:
    """Return the shard of this index: the same in every process, and of a part of this split only.

    Raises:
        ConfigError: the index is negative, or no instance is as visible as the configuration requires.
        RenderingUnavailableError: OpenGL is missing.
    """
    if index < 0:
        raise ConfigError(f"index of a shard must not be negative, got {index}")
    rng = np.random.default_rng([config.seed, split == "validation", 0, index])
    part = random_part(random_part_seed(rng, split))
    queries: list[_Query] = []
    for _ in range(_BINS):
        scene = random_bin(config, part, rng, split)
        queries = _look_around(config, scene, part, rng)
        if queries:
            break
    else:
        raise ConfigError(
            f"an instance of {part.name} must show {config.min_visible_px} px and a share of"
            f" {config.min_visible_fraction:.2f}, none did in {_BINS} bins; lower these limits, or raise diameter_px"
        )
    templates = render_templates(part, config.templates)
    return Shard(
        part=part.name,
        diameter_m=part.diameter_m,
        symmetries=part.symmetries,
        templates=templates,
        rgb=np.stack([q.rgb for q in queries]),
        labels=np.stack([q.labels for q in queries]),
        relief_m=np.stack([q.relief for q in queries]),
        focal_px=np.array([q.focal_px for q in queries]),
        Ts_crop_part=np.stack([q.T_crop_part for q in queries]),
        visible_fractions=np.array([q.visible_fraction for q in queries]),
        source_side_px=np.array([q.source_side_px for q in queries]),
        views=np.array([q.view for q in queries]),
        instances=np.array([q.instance for q in queries]),
    )


def _look_around(config: DataConfig, scene: Scene, part: Part, rng: np.random.Generator) -> list[_Query]:
    """Return queries from view after view until there are enough."""
    own = [i.instance for i in scene.instances if i.part.name == part.name]
    targets_m = scene.positions_m[own]
    queries: list[_Query] = []
    with SceneRenderer(scene) as renderer:
        for view in range(config.cameras):
            viewpoint = draw_viewpoint(config, targets_m, part.diameter_m, rng)
            relight(scene, draw_view_look(config, len(scene.instances), rng))
            renderer.renderer.upload_textures()
            wanted = min(config.queries_per_camera, config.queries - len(queries))
            queries += _queries_of_view(config, renderer, scene, viewpoint, view, own, wanted, rng)
            if len(queries) == config.queries:
                break
    return queries


def _is_inside(visibility: Visibility, camera: Pinhole) -> bool:
    """Return whether the whole silhouette, including hidden pixels, is within the image."""
    x1, y1, x2, y2 = visibility.box_silhouette_xyxy_px
    return bool(x1 >= 0 and y1 >= 0 and x2 <= camera.width and y2 <= camera.height)


def _queries_of_view(
    config: DataConfig,
    renderer: SceneRenderer,
    scene: Scene,
    viewpoint: Viewpoint,
    view: int,
    own: list[int],
    wanted: int,
    rng: np.random.Generator,
) -> list[_Query]:
    frame = renderer.capture(viewpoint)
    assert frame.instances is not None and frame.depth_m is not None
    seen = np.bincount(frame.instances[frame.instances >= 0], minlength=len(scene.instances))
    fractions: dict[int, float] = {}
    # Each instance is rendered alone to measure it, so stop when there are enough.
    for instance in rng.permutation([k for k in own if seen[k] >= config.min_visible_px]):
        if len(fractions) == wanted:
            break
        k = int(instance)
        measured = measure_instance(renderer, k, int(seen[k]), frame.camera, frame.T_world_camera)
        # Instances cut by the image border are left out: frequent in these zoomed views, rare in real ones.
        if (
            measured is not None
            and measured.fraction >= config.min_visible_fraction
            and _is_inside(measured, frame.camera)
        ):
            fractions[k] = measured.fraction
    masks = [frame.instances == k for k in fractions]
    boxes = np.array([box_of_mask(mask) for mask in masks]).reshape(-1, 4)
    rgb = frame.rgb
    effects_rng = rng.spawn(1)[0]
    if effects_rng.random() < config.effects_share:
        rgb = apply_camera_effects(rgb, config.effects, effects_rng)
    crops = crop_images(rgb, frame.camera, boxes, config.crop_px, masks=masks, padding=config.crop_padding)
    assert crops.masks is not None
    Ts_crop_world = crops.cameras.Ts_crop_camera @ invert(frame.T_world_camera)
    return [
        _Query(
            rgb=crops.rgb[row],
            labels=_labels(frame.instances, k, frame.camera, crops, row),
            relief=_relief(frame.depth_m, frame.camera, crops, row, Ts_crop_world[row] @ scene.T_world_part(k)),
            focal_px=float(crops.cameras.focal_px[row]),
            T_crop_part=Ts_crop_world[row] @ scene.T_world_part(k),
            visible_fraction=fraction,
            source_side_px=float((boxes[row, 2:] - boxes[row, :2]).max()),
            view=view,
            instance=k,
        )
        for row, (k, fraction) in enumerate(fractions.items())
    ]


def _labels(
    instances: Int[np.ndarray, "height width"], own: int, camera: Pinhole, crops: CropBatch, row: int
) -> UInt8[np.ndarray, "size size"]:
    """Return the labels of a crop, see `Shard.labels`."""
    assert crops.masks is not None
    size = crops.cameras.size_px
    nearest = cv2.warpPerspective(
        instances.astype(np.float32),
        _to_crop(camera, crops, row),
        (size, size),
        flags=cv2.INTER_NEAREST,
        borderValue=(-1,),
    ).astype(np.int64)
    others = np.unique(nearest[(nearest >= 0) & (nearest != own)])
    labels = np.zeros((size, size), np.uint8)
    for number, instance in enumerate(others[: 255 - OWN - 1], start=OWN + 1):
        labels[nearest == instance] = number
    labels[crops.masks[row]] = OWN
    return labels


def _to_crop(camera: Pinhole, crops: CropBatch, row: int) -> Float[np.ndarray, "3 3"]:
    """Return the homography to a crop's pixels for OpenCV, which has pixel centres at integers."""
    to_corners = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
    return np.linalg.inv(to_corners) @ crops.cameras.homographies(camera)[row] @ to_corners


def _relief(
    depth_m: Float32[np.ndarray, "height width"],
    camera: Pinhole,
    crops: CropBatch,
    row: int,
    T_crop_part: Float[np.ndarray, "4 4"],
) -> Float16[np.ndarray, "size size"]:
    """Return the depth of the nearest source pixel's surface minus that of the part's origin, along the crop's axis."""
    size = crops.cameras.size_px
    z = cv2.warpPerspective(depth_m, _to_crop(camera, crops, row), (size, size), flags=cv2.INTER_NEAREST)
    # Depth is measured along the source camera's axis, where a crop's ray of depth 1 has this depth.
    rays = crops.cameras.pinhole(row).rays() @ crops.cameras.Rs_crop_camera[row][:, 2]
    return np.where(crops.masks[row], z / rays - T_crop_part[2, 3], 0).astype(np.float16)  # pyright: ignore
