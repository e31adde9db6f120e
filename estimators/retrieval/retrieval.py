"""`RetrievalEstimator`: the pose of the template most similar to the image. No training, no weights."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import torch
from annotated_types import Ge, Interval
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.config import Config, PositiveFloat
from simpick.estimators.floor import Floor
from simpick.estimators.retrieval.descriptors import CROP_PX, describe, luminance
from simpick.estimators.retrieval.template_index import Matches, TemplateIndex, load_index
from simpick.estimators.retrieval.turned_crops import PADDING
from simpick.estimators.valid_detections import check_onboarded, valid_detections
from simpick.geometry import CropBatch, crop_images, transform
from simpick.records import CameraFrame, Detection, PoseEstimate, PoseHypothesis
from simpick.rendering import TemplateConfig


@dataclass(frozen=True)
class RetrievalConfig(Config):
    """How templates are made and searched."""

    views: int = 162
    """Directions of the templates on the view sphere: 42, 162 or 642."""
    turns: Annotated[int, Interval(ge=4, le=360)] = 36
    """In-plane rotations of each view."""
    hypotheses: Annotated[int, Interval(ge=1, le=200)] = 5
    """Poses per detection, best first."""
    spacing_deg: Annotated[float, Interval(ge=0, le=90)] = 15.0
    """Minimum angle between two hypotheses, over the part's symmetries."""
    smoothing_deg: Annotated[float, Interval(ge=0, le=90)] = 35.0
    """A hypothesis is an average over the templates within this angle."""
    softness: PositiveFloat = 0.03
    """Decrease of similarity at which a template's weight in that average falls to 1/e."""
    min_mask_px: Annotated[int, Ge(2)] = 16
    """Detections with fewer pixels get no estimate."""

    def _check_rules(self) -> None:
        TemplateConfig(views=self.views)


class RetrievalEstimator:
    """Finds each detection's nearest templates among all views and in-plane rotations. Implements `PoseEstimator`.

    Image and templates are compared in virtual-camera crops (see `simpick.geometry.crops`), so a match is a pose in the
    crop's frame, and its distance follows from the size of the detection's box. If a part is partly hidden, the box
    encloses only what is visible, and distance and position are wrong accordingly.
    """

    mode = "retrieval"

    def __init__(self, config: RetrievalConfig | None = None) -> None:
        self.config = config or RetrievalConfig()
        self._indices: dict[str, tuple[Part, TemplateIndex]] = {}

    def onboard(self, part: Part, *, progress: Callable[[int, int], None] | None = None) -> None:
        """Render and describe the part's templates, which takes seconds, or read them from the cache."""
        known = self._indices.get(part.name)
        if known is None or known[0].content_hash != part.content_hash:
            index = load_index(part, TemplateConfig(views=self.config.views), self.config.turns, progress=progress)
            self._indices[part.name] = (part, index)

    def estimate(self, frame: CameraFrame, detections: Sequence[Detection]) -> list[PoseEstimate]:
        """Return the best pose of each detection, with hypotheses.

        A detection has no estimate if its mask has fewer than `RetrievalConfig.min_mask_px` pixels, or its box is
        outside the image. The mask, if there is one, defines the box; otherwise the whole box counts as mask.

        Raises:
            UnknownNameError: a detection's part has not been onboarded.
            ConfigError: a mask has another size than the image.
        """
        return self.estimate_batch([frame], [detections])[0]

    def estimate_batch(
        self, frames: Sequence[CameraFrame], detections: Sequence[Sequence[Detection]]
    ) -> list[list[PoseEstimate]]:
        """Return the estimates for each frame; the crops of all frames are described and searched together."""
        start = time.perf_counter()
        for found in detections:
            check_onboarded(found, self._indices)
        cropped = [self._crop(frame, found) for frame, found in zip(frames, detections, strict=True)]
        kept = [(k, d) for k, (found, _) in enumerate(cropped) for d in found]
        estimates: list[list[PoseEstimate]] = [[] for _ in frames]
        if not kept:
            return estimates
        crops = [crop for _, crop in cropped if crop is not None]
        images = torch.from_numpy(np.concatenate([crop.rgb for crop in crops]))
        masks = torch.from_numpy(np.concatenate([crop.masks for crop in crops if crop.masks is not None]))
        with torch.inference_mode():
            queries = describe(luminance(images), masks)
        focal_px = np.concatenate([crop.cameras.focal_px for crop in crops])
        Rs_crop_camera = np.concatenate([crop.cameras.Rs_crop_camera for crop in crops])
        found_poses: dict[int, tuple[PoseHypothesis, ...]] = {}
        for part in dict.fromkeys(d.part for _, d in kept):
            rows = [i for i, (_, d) in enumerate(kept) if d.part == part]
            matches = self._search(part, queries[rows])
            found_poses.update(zip(rows, _hypotheses(matches, focal_px[rows], Rs_crop_camera[rows]), strict=True))
        elapsed_s = (time.perf_counter() - start) / len(kept)
        for i, (k, d) in enumerate(kept):
            best = found_poses[i][0]
            estimates[k].append(
                PoseEstimate(d.part, best.T_camera_part, best.score, self.mode, elapsed_s, found_poses[i], detection=d)
            )
        parts = {name: part for name, (part, _) in self._indices.items()}
        return [Floor.under(frame, own, parts) for frame, own in zip(frames, estimates, strict=True)]

    def _crop(self, frame: CameraFrame, detections: Sequence[Detection]) -> tuple[list[Detection], CropBatch | None]:
        """Return the valid detections and their crops; None if there are none."""
        valid = valid_detections(detections, frame, self.config.min_mask_px)
        if not valid:
            return [], None
        masks, boxes = [v.mask for v in valid], np.stack([v.box_xyxy_px for v in valid])
        crops = crop_images(frame.rgb, frame.camera, boxes, CROP_PX, masks=masks, padding=PADDING)
        return [v.detection for v in valid], crops

    def _search(self, part: str, queries: torch.Tensor) -> Matches:
        config = self.config
        return self._indices[part][1].search(
            queries,
            config.hypotheses,
            spacing_rad=np.radians(config.spacing_deg),
            smoothing_rad=np.radians(config.smoothing_deg),
            softness=config.softness,
        )


def _hypotheses(
    matches: Matches, focal_px: Float[np.ndarray, "n"], Rs_crop_camera: Float[np.ndarray, "n 3 3"]
) -> list[tuple[PoseHypothesis, ...]]:
    """Return the matches as poses in the images' own cameras."""
    translations = matches.centres.copy()
    translations[..., 2] *= focal_px[:, None]
    Ts_crop_part = transform(matches.Rs_crop_part, translations)
    Rs_camera_crop = np.swapaxes(Rs_crop_camera, 1, 2)
    Ts_camera_part = transform(Rs_camera_crop)[:, None] @ Ts_crop_part
    return [
        tuple(PoseHypothesis(T, float(score)) for T, score in zip(Ts, scores, strict=True))
        for Ts, scores in zip(Ts_camera_part, matches.scores, strict=True)
    ]
