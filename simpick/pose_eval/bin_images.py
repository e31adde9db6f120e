"""Simulated bins as `PoseImage`s, and their export as a BOP data set."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.bop import BopInstance, BopWriter
from simpick.bop.targets import MIN_VISIBLE_FRACTION
from simpick.estimators.boundary import validated_detections
from simpick.estimators.detections import make_detector
from simpick.geometry import invert
from simpick.pose_eval.pose_images import PoseImage, PoseTruth
from simpick.records import CameraFrame, Detection
from simpick.rendering import SceneRenderer, Visibility, measure_visibility
from simpick.rendering.camera_effects import PHOTO_EFFECTS, apply_camera_effects
from simpick.scene import SceneConfig, build_scene
from simpick.scene.randomization import RANDOMIZATIONS, draw_look
from simpick.scene.relighting import relight

_CAMERA = "overhead"
_PHOTO_STREAM = 2


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
    candidates: tuple[str, ...]
    """The parts that the bin was filled from, in it or not: those that detectors are asked for, as in closed loop."""

    def image(self, detections: str | Sequence[Detection]) -> PoseImage:
        """Return the view with these detections, or those of a name (see `simpick.estimators.detections`).

        Parts that are at least 10 % visible are the targets.

        `PoseImage.scene_id` is the seed, which also determines the noise of the detections.
        """
        counts: dict[str, int] = {}
        for truth in self.truths:
            if truth.visible_fraction >= MIN_VISIBLE_FRACTION:
                counts[truth.part] = counts.get(truth.part, 0) + 1
        start = time.perf_counter()
        found = self._detected(detections) if isinstance(detections, str) else detections
        return PoseImage(
            self.seed, 0, self.frame, tuple(found), self.truths, counts, detection_s=time.perf_counter() - start
        )

    def _detected(self, name: str) -> list[Detection]:
        # The second number separates this stream from the one that the bin itself is drawn from.
        rng = np.random.default_rng((self.seed, 1))
        detector = make_detector(name, [part.name for part in self.parts], rng)
        return validated_detections(detector, self.frame, [get_part(name) for name in self.candidates])


@dataclass(frozen=True, eq=False)
class BinImage:
    """The image of a settled bin, with the silhouettes that an export needs."""

    image: PoseImage
    """`PoseImage.scene_id` is the bin's seed."""
    visibilities: tuple[Visibility, ...]
    """Of the image's truths, in their order."""


def view_bin(config: SceneConfig, seed: int, *, photo: bool = False) -> tuple[BinView, tuple[Visibility, ...]]:
    """Build the bin of a seed and return the overhead camera's view, and the visibility of each of its truths.

    With `photo`, the same parts at the same poses are seen by the same camera in the look of a photograph: the preset
    "photo" of lights, colours and textures, and `PHOTO_EFFECTS` of the camera.
    """
    scene = build_scene(config, seed)
    rng = np.random.default_rng((seed, _PHOTO_STREAM))
    if photo:
        relight(scene, draw_look(RANDOMIZATIONS["photo"], len(scene.instances), rng))
    with SceneRenderer(scene) as renderer:
        frame = renderer.capture(_CAMERA)
        visibilities = measure_visibility(renderer, _CAMERA)
    if photo:
        frame = replace(frame, rgb=apply_camera_effects(frame.rgb, PHOTO_EFFECTS, rng))
    T_camera_world = invert(frame.T_world_camera)
    parts = tuple(instance.part for instance in scene.instances)
    truths = tuple(
        PoseTruth(
            parts[v.instance].name, T_camera_world @ scene.T_world_part(v.instance), float(v.fraction), v.instance
        )
        for v in visibilities
    )
    return BinView(seed, frame, parts, truths, config.parts), visibilities


def bin_images(
    config: SceneConfig, seeds: Sequence[int], detections: str | Callable[[BinView], Sequence[Detection]] = "perfect"
) -> Iterator[BinImage]:
    """Build a bin for each seed and yield its image with depth, truth, targets and detections.

    `detections` are named (see `simpick.estimators.detections`), or a function returns those of a view.
    """
    for seed in seeds:
        view, visibilities = view_bin(config, seed)
        found = detections if isinstance(detections, str) else detections(view)
        yield BinImage(view.image(found), visibilities)


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
