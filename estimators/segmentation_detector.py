"""`SegmentationDetector`: detections from the simulator's own segmentation, perfect or perturbed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Int

from simpick.assets.part import Part
from simpick.errors import ConfigError
from simpick.estimators.detection_noise import DetectionNoise, detection_noise, jittered_box, miss_and_merge, ragged
from simpick.geometry import box_of_mask
from simpick.records import CameraFrame, Detection


class SegmentationDetector:
    """Returns every visible instance, subject to `noise`. Implements `Detector`.

    Boxes are modal: they enclose the visible pixels. The score is the visible area relative to the largest, so that
    parts on top come first.
    """

    def __init__(
        self,
        noise: DetectionNoise | str = "perfect",
        rng: np.random.Generator | None = None,
        *,
        instance_parts: Sequence[str] | Callable[[], Sequence[str]],
        min_visible_px: int = 64,
    ) -> None:
        """Take the name of each instance's part from `instance_parts`, by instance number.

        `noise` is a `DetectionNoise` or the name of a preset. `instance_parts` may be a function, which is called for
        every frame. Instances with fewer visible pixels than `min_visible_px` are not detected.

        Raises:
            UnknownNameError: there is no such preset.
            ConfigError: there is noise, but no generator to draw it from.
        """
        self.noise = detection_noise(noise) if isinstance(noise, str) else noise
        if min_visible_px < 1:
            raise ConfigError(f"min_visible_px must be 1 or more, got {min_visible_px}")
        if rng is None and self.noise != DetectionNoise(masks=self.noise.masks):
            raise ConfigError("noisy detections need a random generator: pass rng=numpy.random.default_rng(seed)")
        self._rng = rng
        self._instance_parts = instance_parts
        self.min_visible_px = min_visible_px

    def detect(self, frame: CameraFrame, parts: Sequence[Part]) -> list[Detection]:
        """Return detections of these parts, the largest visible area first.

        Raises:
            ConfigError: the frame has no instance ids, or shows an instance whose part is not known.
        """
        if frame.instances is None:
            raise ConfigError(
                "detections from segmentation need a frame with instance ids: capture(..., instances=True)"
            )
        names = self._instance_parts() if callable(self._instance_parts) else self._instance_parts
        visible_px = np.bincount(frame.instances[frame.instances >= 0], minlength=1)
        if len(visible_px) > max(len(names), 1):
            raise ConfigError(
                f"the frame shows instance {len(visible_px) - 1}, but parts of only {len(names)} are given"
            )
        wanted = {part.name for part in parts}
        seen = np.flatnonzero(visible_px >= self.min_visible_px).tolist()
        found = [k for k in seen if names[k] in wanted]
        if self._rng is None:
            covers = {k: (k,) for k in found}
        else:
            covers = miss_and_merge(frame.instances, np.array(found, np.int64), self.noise, self._rng)
        masks = {k: _mask_of(frame.instances, covered) for k, covered in covers.items()}
        detections = [self._detection(names[k], k, mask, int(visible_px.max())) for k, mask in masks.items()]
        return sorted((d for d in detections if d is not None), key=lambda d: (-d.score, d.instance))

    def _detection(
        self, part: str, instance: int, mask: Bool[np.ndarray, "height width"], largest_px: int
    ) -> Detection | None:
        height, width = mask.shape
        if self._rng is not None:
            mask = ragged(mask, self.noise.ragged_px, self._rng)
        if not mask.any():
            return None
        box = box_of_mask(mask)
        if self._rng is not None:
            box = jittered_box(box, self.noise.box_jitter, self._rng, width, height)
        score = min(np.count_nonzero(mask) / largest_px, 1.0)
        return Detection(part, box, mask if self.noise.masks else None, score, instance)


def _mask_of(instances: Int[np.ndarray, "height width"], covered: Sequence[int]) -> Bool[np.ndarray, "height width"]:
    """Return the pixels of these instances, of which there is at least one."""
    first, *merged = covered
    mask = instances == first
    for instance in merged:
        mask |= instances == instance
    return mask
