"""What image encoders return."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from simpick.tensor_record import TensorRecord


@dataclass(frozen=True, eq=False)
class FeatureMaps(TensorRecord):
    """Feature vectors of crops, on a coarse and a fine level."""

    coarse: Float[Tensor, "batch width cells cells"]
    """One feature vector per cell."""
    fine: Float[Tensor, "batch fine_width fine_cells fine_cells"] | None
    """One per cell of half the width; None if the encoder has no fine level."""
