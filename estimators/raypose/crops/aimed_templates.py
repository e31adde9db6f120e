"""Templates as virtual cameras: which view, how turned and framed, and in which of its equivalent poses."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from simpick.estimators.raypose.crops.virtual_recrops import VirtualRecrops, aim_virtual_recrops
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.geometry import SymmetryGroup, rotated_boxes, transform
from simpick.rendering import TemplateSet
from simpick.tensor_record import TensorRecord


@dataclass(frozen=True, eq=False)
class AimedTemplates(TensorRecord):
    """Virtual cameras on views of one part; no images yet."""

    views: Int[np.ndarray, "n"]
    recrops: VirtualRecrops
    Ts_crop_part: Float[np.ndarray, "n 4 4"]

    def __len__(self) -> int:
        return len(self.views)

    def nearest_to(self, Ts_crop_part: Float[np.ndarray, "*#n 4 4"], symmetries: SymmetryGroup) -> AimedTemplates:
        """Return the same views with those of their equivalent poses that are rotated least against the given ones.

        Then the templates of a symmetric part agree: the same place on it has about the same position in all of them.
        """
        if symmetries.is_trivial:
            return self
        return dataclasses.replace(self, Ts_crop_part=symmetries.closest_equivalent(self.Ts_crop_part, Ts_crop_part))


def aim_at_templates(
    templates: TemplateSet,
    views: Int[np.ndarray, "n"],
    angles_rad: Float[np.ndarray, "n"],
    config: RayPoseConfig,
    *,
    shift: Float[np.ndarray, "n 2"] | None = None,
    zoom: Float[np.ndarray, "n"] | None = None,
) -> AimedTemplates:
    """Return cameras on the given views turned clockwise by the angles, each framed by its silhouette's box.

    `shift` moves each box by this share of its longer side and `zoom` enlarges it, as if the template's camera stood
    elsewhere.
    """
    source, focal = templates.camera.width, np.full(len(views), templates.camera.fx)
    boxes = rotated_boxes(templates.masks[views], angles_rad[:, None])[:, 0]
    centre, size = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    if shift is not None:
        centre = centre + shift * size.max(axis=1, keepdims=True)
    if zoom is not None:
        size = size * zoom[:, None]
    boxes = np.concatenate([centre - size / 2, centre + size / 2], axis=1)
    recrops = aim_virtual_recrops(source, focal, angles_rad, boxes, config.crop_px, padding=config.padding)
    return AimedTemplates(views, recrops, transform(recrops.Rs_crop_source) @ templates.Ts_camera_part[views])
