"""Simulated bins as `PoseImage`s, and their export as a BOP data set."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from simpick.assets.part import Part
from simpick.bop import BopInstance, BopWriter
from simpick.bop.targets import MIN_VISIBLE_FRACTION
from simpick.estimators.boundary import validated_detections
from simpick.estimators.detections import make_detector
from simpick.geometry import invert
from simpick.pose_eval.pose_images import PoseImage, PoseTruth
from simpick.records import CameraFrame
from simpick.rendering import SceneRenderer, Visibility, measure_visibility
from simpick.scene import SceneConfig, build_scene

_CAMERA = "overhead"


@dataclass(frozen=True, eq=False)
class BinView:
    """The overhead camera's image of a settled bin with its ground truth, without detections."""

    seed: int
    """Seed of the bin."""
    frame: CameraFrame
    """With depth and instance ids."""
    parts: tuple[Part, ...]
    """The part of each instance, by instance number."""
    truths: tuple[PoseTruth, ...]

    def image(self, detections: str) -> PoseImage:
        """Return the view with detections by name (see `simpick.estimators.detections`).

        Parts that are at least 10 % visible are the targets.

        `PoseImage.scene_id` is the seed, which also determines the noise of the detections.
        """
        counts: dict[str, int] = {}
        for truth in self.truths:
            if truth.visible_fraction >= MIN_VISIBLE_FRACTION:
                counts[truth.part] = counts.get(truth.part, 0) + 1
        # The second number separates this stream from the one that the bin itself is drawn from.
        rng = np.random.default_rng((self.seed, 1))
        detector = make_detector(detections, [part.name for part in self.parts], rng)
        start = time.perf_counter()
        found = validated_detections(detector, self.frame, list({part.name: part for part in self.parts}.values()))
        return PoseImage(
            self.seed, 0, self.frame, tuple(found), self.truths, counts, detection_s=time.perf_counter() - start
        )


@dataclass(frozen=True, eq=False)
class BinImage:
    """The image of a settled bin, with the silhouettes that an export needs."""

    image: PoseImage
    """`PoseImage.scene_id` is the bin's seed."""
    visibilities: tuple[Visibility, ...]
    """Of the image's truths, in their order."""


def view_bin(config: SceneConfig, seed: int) -> tuple[BinView, tuple[Visibility, ...]]:
    """Build the bin of a seed and return the overhead camera's view, and the visibility of each of its truths."""
    scene = build_scene(config, seed)
    with SceneRenderer(scene) as renderer:
        frame = renderer.capture(_CAMERA)
        visibilities = measure_visibility(renderer, _CAMERA)
    T_camera_world = invert(frame.T_world_camera)
    parts = tuple(instance.part for instance in scene.instances)
    truths = tuple(
        PoseTruth(
            parts[v.instance].name, T_camera_world @ scene.T_world_part(v.instance), float(v.fraction), v.instance
        )
        for v in visibilities
    )
    return BinView(seed, frame, parts, truths), visibilities


def bin_images(config: SceneConfig, seeds: Sequence[int], detections: str = "perfect") -> Iterator[BinImage]:
    """Build a bin for each seed and yield its image with depth, truth, targets and detections of this preset."""
    for seed in seeds:
        view, visibilities = view_bin(config, seed)
        yield BinImage(view.image(detections), visibilities)


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
