"""Fresh simulated bins as `PoseImage`s, and as a BOP data set on disk."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from simpick.bop import BopInstance, BopWriter
from simpick.bop.targets import MIN_VISIBLE_FRACTION
from simpick.estimators.segmentation_detector import SegmentationDetector
from simpick.evaluation.pose_images import PoseImage, PoseTruth
from simpick.geometry import invert
from simpick.rendering import SceneRenderer, Visibility, measure_visibility
from simpick.scene import SceneConfig, build_scene


@dataclass(frozen=True, eq=False)
class BinImage:
    """A settled bin, seen from above."""

    image: PoseImage
    """`PoseImage.scene_id` is the bin's seed."""
    visibilities: tuple[Visibility, ...]
    """Of the image's truths, in their order: silhouettes for export."""


def bin_images(
    config: SceneConfig, seeds: Sequence[int], noise: str = "perfect", *, camera: str = "overhead"
) -> Iterator[BinImage]:
    """Build a bin for each seed and yield its image with depth, truth and targets.

    `noise` is the preset of the detections; the parts at least a tenth visible are the targets.
    """
    for seed in seeds:
        scene = build_scene(config, seed)
        with SceneRenderer(scene) as renderer:
            frame = renderer.capture(camera)
            visibilities = measure_visibility(renderer, camera)
        T_camera_world = invert(frame.T_world_camera)
        truths, counts = [], {}
        for v in visibilities:
            name = scene.instances[v.instance].part.name
            truths.append(PoseTruth(name, T_camera_world @ scene.T_world_part(v.instance), v.fraction, v.instance))
            if v.fraction >= MIN_VISIBLE_FRACTION:
                counts[name] = counts.get(name, 0) + 1
        parts = {instance.part.name: instance.part for instance in scene.instances}
        names = [instance.part.name for instance in scene.instances]
        # The second number keeps this stream apart from the one that the bin itself is drawn from.
        detector = SegmentationDetector(noise, np.random.default_rng((seed, 1)), instance_parts=names)
        detections = detector.detect(frame, list(parts.values()))
        image = PoseImage(seed, 0, frame, tuple(detections), tuple(truths), counts)
        yield BinImage(image, visibilities)


def export_bin(writer: BopWriter, bin_image: BinImage) -> int:
    """Add a bin to a BOP data set and return the image's id; the bin's seed is the scene's id."""
    image, frame = bin_image.image, bin_image.image.frame
    assert frame.instances is not None
    height, width = frame.rgb.shape[:2]
    instances = [
        BopInstance(
            t.part, t.T_camera_part, v.silhouette(height, width), frame.instances == t.instance, v.silhouette_px
        )
        for t, v in zip(image.truths, bin_image.visibilities, strict=True)
    ]
    return writer.add(image.scene_id, frame, instances)
