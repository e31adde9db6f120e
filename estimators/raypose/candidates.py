"""`Candidates`: poses of detections on their way to an answer, any number per detection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from simpick.estimators.pose_selection import best_per_group
from simpick.tensor_record import TensorRecord


@dataclass(frozen=True, eq=False)
class Candidates(TensorRecord):
    """Poses of detections, any number each."""

    detections: Int[np.ndarray, "n"]
    """Row of the detection that each belongs to."""
    crops: Int[np.ndarray, "n"]
    """Row of the crop that each is seen in: one of the detection's rotated crops."""
    Ts_camera_part: Float[np.ndarray, "n 4 4"]
    scores: Float[np.ndarray, "n"]

    def best(self, count: int) -> Candidates:
        """Return the `count` candidates of each detection with the highest scores."""
        return self.rows(self.best_rows(count))

    def best_rows(self, count: int) -> Int[np.ndarray, "m"]:
        """Return the rows of `best`."""
        return best_per_group(self.detections, -self.scores, count)
