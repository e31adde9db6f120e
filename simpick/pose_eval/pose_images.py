"""`PoseImage`: one image with all that pose estimation is measured by, wherever it comes from."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.metrics.models import EvaluationModel
from simpick.records import CameraFrame, Detection


@dataclass(frozen=True, eq=False)
class PoseTruth:
    """One annotated instance."""

    part: str
    T_camera_part: Float[np.ndarray, "4 4"]
    visible_fraction: float
    """Share of the silhouette that is seen."""
    instance: int
    """What `Detection.instance` says of a detection that came from it."""


@dataclass(frozen=True, eq=False)
class PoseImage:
    """One image to be estimated and scored."""

    scene_id: int
    im_id: int
    frame: CameraFrame
    """With depth where VSD is wanted."""
    detections: tuple[Detection, ...]
    """What the estimator is given."""
    truths: tuple[PoseTruth, ...]
    """Every annotated instance, targets or not."""
    inst_counts: dict[str, int] = field(default_factory=dict)
    """How many instances of each part are to be found: the image's targets."""
    detection_s: float = 0.0
    """Time that the detections took, for the times in results; 0 if unknown."""


@dataclass(frozen=True, eq=False)
class PoseModel:
    """What of a part is measured on and rendered."""

    evaluation: EvaluationModel
    rendered: Part
    """What VSD renders: for a BOP data set its eval model, whose frame may be another than the part's."""
    T_part_rendered: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))

    @staticmethod
    def of(part: Part) -> PoseModel:
        """Return the model of a part that is measured and rendered as it is."""
        return PoseModel(EvaluationModel.of(part), part)
