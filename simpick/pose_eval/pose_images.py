"""`PoseImage`: one image with its detections, true poses and targets, whatever its origin."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from jaxtyping import Float

from simpick.assets.library import get_part
from simpick.assets.part import Part
from simpick.metrics.models import EvaluationModel
from simpick.records import CameraFrame, Detection


@dataclass(frozen=True, eq=False)
class PoseTruth:
    """One annotated instance."""

    part: str
    T_camera_part: Float[np.ndarray, "4 4"]
    visible_fraction: float
    """Visible fraction of the silhouette."""
    instance: int
    """`Detection.instance` of the detections of this instance."""


@dataclass(frozen=True, eq=False)
class PoseImage:
    """One image whose poses are to be estimated and scored."""

    scene_id: int
    im_id: int
    frame: CameraFrame
    """With depth if VSD is to be computed."""
    detections: tuple[Detection, ...]
    """The estimator's input."""
    truths: tuple[PoseTruth, ...]
    """All annotated instances, including those that are not targets."""
    inst_counts: dict[str, int] = field(default_factory=dict)
    """The image's targets: number of instances to be found, by part."""
    detection_s: float = 0.0
    """Time that detection took, for results files; 0 if unknown."""


@dataclass(frozen=True, eq=False)
class PoseModel:
    """The geometry of a part that errors are measured on, and the part that is rendered."""

    evaluation: EvaluationModel
    rendered: Part
    """Rendered for VSD: for a BOP data set its eval model, whose frame may differ from the part's."""
    T_part_rendered: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))

    @staticmethod
    def of(part: Part) -> PoseModel:
        """Return the model of a part that is measured and rendered as it is."""
        return PoseModel(EvaluationModel.of(part), part)


@cache
def library_model(name: str) -> PoseModel:
    """Return the model of a library part, with the same symmetries and search tree for each call."""
    return PoseModel.of(get_part(name))
