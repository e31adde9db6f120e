"""Which part each instance is: its crop is compared with the templates of every part that may be in the bin.

A crop alone has no scale: a small part from near looks like a large one from far. But all parts of an image lie about
equally far away, so each match's distance, which follows from the part's true size, is compared with the distance that
suits the image's instances best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from simpick.assets.part import Part
from simpick.config import Config, Fraction, NonNegativeFloat, PositiveFloat
from simpick.estimators.detector.floor_distance import floor_distances
from simpick.estimators.retrieval.descriptors import CROP_PX, describe, luminance
from simpick.estimators.retrieval.template_index import load_index
from simpick.estimators.retrieval.turned_crops import PADDING
from simpick.geometry import box_of_mask, crop_images
from simpick.records import CameraFrame
from simpick.rendering import TemplateConfig

_VIEWS, _TURNS = 42, 36
"""Directions of the templates on the view sphere, and turns of each about the optical axis."""
_GRID = 96
"""Distances that are tried."""


@dataclass(frozen=True)
class NamingConfig(Config):
    """How instances are compared with parts."""

    distance_weight: NonNegativeFloat = 0.03
    """Similarity that a match loses when its distance is off by `distance_spread`."""
    distance_spread: PositiveFloat = 0.12
    """Typical relative deviation of a right match's distance from the image's."""
    worst_distance: NonNegativeFloat = 4.0
    """A match loses at most this many times `distance_weight`."""
    highest_m: PositiveFloat = 0.1
    """The instances' common height above the floor is at most this, where the camera's pose is known."""
    alike: Fraction = 0.9
    """Parts whose views are at least this similar on average are reported as alike."""


@dataclass(frozen=True, eq=False)
class NamedInstances:
    """Comparison of each instance with each part."""

    similarity: Float[np.ndarray, "instances parts"]
    """Of the best template, in [0, 1], less what its distance costs."""
    distance_m: float
    """Median distance of the image's instances; NaN without any."""
    is_distance_known: bool
    """Whether the distance follows from the camera's pose, but for the height of the pile."""


@dataclass(frozen=True, eq=False)
class _Templates:
    """Templates of one part."""

    descriptors: Float[Tensor, "templates dimensions"]
    """In half precision, as they are on disk."""
    log_size: Float[Tensor, "templates"]
    """Logarithm of the distance in metres per pixel of focal length at which a crop looks like this."""


class PartNaming:
    """Compares instances with parts; parts are onboarded when they are first asked for."""

    def __init__(self, config: NamingConfig | None = None) -> None:
        self.config = config or NamingConfig()
        self._of_part: dict[str, _Templates] = {}

    def onboard(self, part: Part) -> None:
        """Prepare the part's templates, or take them from the cache on disk."""
        if part.content_hash not in self._of_part:
            index = load_index(part, TemplateConfig(views=_VIEWS), _TURNS)
            log_size = torch.from_numpy(index.centres[:, 2]).clamp_min(1e-9).log()
            self._of_part[part.content_hash] = _Templates(index.descriptors.half(), log_size)

    def compare(
        self, frame: CameraFrame, masks: Sequence[Bool[np.ndarray, "height width"]], parts: Sequence[Part]
    ) -> NamedInstances:
        """Return how similar each instance is to each part.

        Raises:
            ConfigError: the image has another size than its camera.
        """
        if not masks:
            return NamedInstances(np.zeros((0, len(parts))), float("nan"), False)
        templates = self._templates(parts)
        boxes = np.stack([box_of_mask(mask) for mask in masks])
        crops = crop_images(frame.rgb, frame.camera, boxes, CROP_PX, masks=masks, padding=PADDING)
        assert crops.masks is not None
        floor_m = floor_distances(frame, crops.cameras.Rs_crop_camera[:, 2])
        shifts = None if floor_m is None else self._pile_shifts(float(frame.T_world_camera[2, 3]))
        start_m = np.ones(len(masks)) if floor_m is None else floor_m
        with torch.inference_mode():
            queries = describe(luminance(torch.from_numpy(crops.rgb)), torch.from_numpy(crops.masks))
            # In single precision a part at a time: that stays in the cache, where all together would not.
            scores = torch.stack([queries @ t.descriptors.float().T for t in templates], dim=1)
            log_ratio = torch.from_numpy(np.log(crops.cameras.focal_px / start_m)).float()
            log_size = torch.stack([t.log_size for t in templates])
            shift = self._common_shift(scores, log_ratio, log_size, shifts)
            scores -= self._penalty(log_ratio[:, None, None] + (log_size - shift))
        distance_m = float(np.median(start_m) * np.exp(shift))
        return NamedInstances(scores.amax(dim=2).double().numpy(), distance_m, floor_m is not None)

    def alike(self, parts: Sequence[Part]) -> list[tuple[str, str]]:
        """Return the names of each two parts that look alike from everywhere and are about equally large."""
        for part in parts:
            self.onboard(part)
        return [
            (first.name, second.name)
            for first, second in combinations(parts, 2)
            if min(self._mean_similarity(first, second), self._mean_similarity(second, first)) >= self.config.alike
        ]

    def _mean_similarity(self, first: Part, second: Part) -> float:
        """Return the mean similarity of the first part's views to the second's most similar ones, at one distance."""
        ours, theirs = self._of_part[first.content_hash], self._of_part[second.content_hash]
        views = slice(None, None, _TURNS)
        scores = ours.descriptors[views].float() @ theirs.descriptors.float().T
        ratio = ours.log_size[views, None] - theirs.log_size[None]
        return float((scores - self._penalty(-ratio.abs())).amax(dim=1).mean())

    def _templates(self, parts: Sequence[Part]) -> list[_Templates]:
        for part in parts:
            self.onboard(part)
        return [self._of_part[part.content_hash] for part in parts]

    def _penalty(self, deviation: Tensor) -> Tensor:
        config = self.config
        # A hidden part's box is small, as if it were far: that costs half.
        scaled = torch.where(deviation > 0, 0.5 / config.distance_spread, 1 / config.distance_spread).mul_(deviation)
        return scaled.square_().clamp_max_(config.worst_distance).mul_(config.distance_weight)

    def _pile_shifts(self, eye_m: float) -> Float[Tensor, "shifts"]:
        """Return what the pile's possible heights change in the logarithm of the distance, seen from this height."""
        heights = np.linspace(0, min(self.config.highest_m, eye_m / 2), _GRID)
        return torch.from_numpy(np.log1p(-heights / eye_m)).float()

    def _common_shift(
        self,
        scores: Float[Tensor, "instances parts templates"],
        log_ratio: Float[Tensor, "instances"],
        log_size: Float[Tensor, "parts templates"],
        shifts: Float[Tensor, "shifts"] | None,
    ) -> float:
        """Return the logarithm of the common distance at which the instances' best matches are best in sum.

        `log_ratio` is the focal length in pixels by the distance that the shift begins from; without `shifts`, all
        distances of matches are tried.
        """
        best = scores.max(dim=2)
        distance = log_ratio[:, None] + log_size.gather(1, best.indices.T).T
        if shifts is None:
            shifts = torch.linspace(float(distance.min()), float(distance.max()), _GRID)
        totals = (best.values[..., None] - self._penalty(distance[..., None] - shifts)).amax(dim=1).sum(dim=0)
        return float(shifts[int(totals.argmax())])
