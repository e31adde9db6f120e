"""`LearnedDetector`: finds parts that it was never trained on, from the image and the parts' CAD alone."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from simpick.assets.part import Part
from simpick.config import Config, Fraction
from simpick.estimators.detector.affinities import STRIDE
from simpick.estimators.detector.checkpoints import load_detector_checkpoint, shipped_detector_checkpoint
from simpick.estimators.detector.colours import cad_colours, colour_evidence, instance_colours
from simpick.estimators.detector.comparison import ComparedInstances
from simpick.estimators.detector.composition import CompositionModel, judge_instances, read_composition
from simpick.estimators.detector.naming import PartNaming
from simpick.estimators.detector.scores import exposure
from simpick.estimators.detector.segmenter import WORKING_PX, InstanceSegmenter
from simpick.estimators.detector.view_naming import ViewNaming
from simpick.geometry import box_of_mask
from simpick.records import CameraFrame, Detection


class AlikePartsWarning(UserWarning):
    """Two of the parts that may be in the bin look so alike that their names may be confused."""


@dataclass(frozen=True)
class LearnedDetectorConfig(Config):
    """What counts as a detection."""

    min_score: Fraction = 0.01
    """Detections with a lower probability are dropped."""
    min_presence: Fraction = 0.5
    """An image that shows any of the parts with a lower probability gives no detections."""
    colours: bool = True
    """Whether the colours of the CAD help to name instances, as far as they agree with the image."""


class LearnedDetector:
    """Segments the image without regard to parts, then names each instance. Implements `ForegroundDetector`.

    Of the frame it reads `rgb`, `camera` and, where it is known, `T_world_camera`: neither depth nor instance ids.
    """

    def __init__(self, weights: Path | None = None, config: LearnedDetectorConfig | None = None) -> None:
        """Load the network; `weights` are those of another training than the shipped ones.

        Raises:
            CheckpointError: the weights are missing, damaged, or of another network.
        """
        self.config = config or LearnedDetectorConfig()
        checkpoint = load_detector_checkpoint(weights or shipped_detector_checkpoint())
        self.segmenter = InstanceSegmenter(checkpoint.network, checkpoint.score)
        self.naming = PartNaming()
        self.view_naming = ViewNaming()
        self._checked: set[frozenset[tuple[str, str]]] = set()
        self._seen: tuple[np.ndarray, np.ndarray] | None = None
        """The last image and its foreground, so that asking for both runs the network once."""

    @cached_property
    def composition(self) -> CompositionModel:
        """Return the distributions that instances are judged by; raises ConfigError if they are missing or damaged."""
        return read_composition()

    @property
    def min_visible_px(self) -> int:
        """Return the fewest pixels of an instance that are detected, in an image of 640 x 480 px."""
        return round(self.segmenter.config.min_cells * (STRIDE * 640 / WORKING_PX) ** 2)

    def onboard(self, part: Part) -> None:
        """Prepare the part's templates, or take them from the cache; `detect` does it for parts that are new."""
        self.naming.onboard(part)
        self.view_naming.onboard(part)

    def detect(self, frame: CameraFrame, parts: Sequence[Part]) -> list[Detection]:
        """Return detections of these parts, the most probable first; none for what is none of the parts.

        The score is the probability that the mask overlaps one instance of this part by an IoU of at least one half.
        The list is empty where the image as a whole probably shows none of the parts.

        Raises:
            ConfigError: the image is not of 8-bit RGB, has another size than its camera, or is smaller than 32 px.

        Warns:
            AlikePartsWarning: two parts look so alike that their names may be confused; once for each set of parts.
        """
        if not parts:
            return []
        self._warn_of_alike(parts)
        instances = self.compare(frame, parts)
        if not instances.masks:
            return []
        judged = judge_instances(instances, self.composition)
        if judged.presence < self.config.min_presence:
            return []
        detections = [
            Detection(parts[int(part)].name, box_of_mask(mask), mask, float(score))
            for mask, part, score in zip(instances.masks, judged.part, judged.probability, strict=True)
            if score >= self.config.min_score
        ]
        return sorted(detections, key=lambda detection: -detection.score)

    def compare(self, frame: CameraFrame, parts: Sequence[Part]) -> ComparedInstances:
        """Return all instances of the image, whatever they are, and how they compare with these parts.

        Raises:
            ConfigError: as `detect`.
        """

        def judge(masks: Sequence[Bool[np.ndarray, "height width"]]) -> Float[np.ndarray, "masks"]:
            return self.naming.compare(frame, masks, parts).similarity.max(axis=1)

        found = self.segmenter.segment(frame.rgb, judge)
        self._seen = frame.rgb.copy(), found.foreground
        return self.compare_masks(frame, found.masks, found.scores, parts)

    def compare_masks(
        self,
        frame: CameraFrame,
        masks: list[Bool[np.ndarray, "height width"]],
        scores: Float[np.ndarray, "instances"],
        parts: Sequence[Part],
    ) -> ComparedInstances:
        """Return how given masks, right with these probabilities, compare with these parts."""
        named = self.naming.compare(frame, masks, parts)
        colours = np.zeros(named.similarity.shape)
        if self.config.colours and len(masks) and len(parts) > 1:
            seen = instance_colours(frame.rgb, masks)
            colours = colour_evidence(named.similarity, scores, seen, cad_colours(parts))
        views = self.view_naming.compare(frame, masks, parts) if masks else np.zeros(named.similarity.shape)
        return ComparedInstances(
            masks, scores, exposure(masks), named.similarity, views, colours, named.is_distance_known
        )

    def foreground(self, frame: CameraFrame) -> Bool[np.ndarray, "height width"]:
        """Return the pixels that show parts, detected or not; costs nothing for the image of the last `detect`.

        Raises:
            ConfigError: as `detect`.
        """
        if self._seen is None or not np.array_equal(self._seen[0], frame.rgb):
            self._seen = frame.rgb.copy(), self.segmenter.segment(frame.rgb).foreground
        return self._seen[1]

    def _warn_of_alike(self, parts: Sequence[Part]) -> None:
        key = frozenset((part.name, part.content_hash) for part in parts)
        if key in self._checked:
            return
        self._checked.add(key)
        if pairs := self.naming.alike(parts):
            names = "; ".join(f"{first} and {second}" for first, second in pairs)
            warnings.warn(
                f"these parts look alike, so detections may confuse their names: {names}",
                AlikePartsWarning,
                stacklevel=3,
            )
