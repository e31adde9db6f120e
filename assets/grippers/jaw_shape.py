"""The parallel jaw's dimensions and the boxes around it: for its model and for the sampling of its grasps."""

from __future__ import annotations

import numpy as np

from simpick.assets.grippers.base import GripperBoxes

JAW_STROKE_M = 0.085
"""Largest opening between the pads."""
PAD_WIDTH_M = 0.020
"""Extent of a pad along y, across the closing direction."""
FINGER_THICKNESS_M = 0.0085
"""Extent of a finger along x, rubber included."""
TIP_BEYOND_TCP_M = 0.010
"""How far the fingertips reach beyond the TCP along the approach."""
PAD_ABOVE_TCP_M = 0.040
"""How far the pads reach back from the TCP, against the approach."""

JAW_TURN_SYMMETRY = 2
"""A half turn about the approach swaps the fingers."""
RUBBER_M = 0.002
"""Thickness of a pad."""
PALM_BOTTOM_M = 0.085
"""Distance from the base to the palm's end."""
FINGER_LENGTH_M = 0.140
"""Distance from the palm to the fingertips."""
TCP_Z_M = PALM_BOTTOM_M + FINGER_LENGTH_M - TIP_BEYOND_TCP_M
"""Distance from the base to the TCP."""
PALM_HALF_M = (0.062, 0.025, 0.032)
CARRIAGE_HALF_M = (0.010, 0.014, 0.008)


def jaw_boxes(opening_m: float) -> GripperBoxes:
    """Return boxes around both fingers, the carriages and the palm at this opening, in the TCP frame."""
    inner, outer = opening_m / 2, opening_m / 2 + FINGER_THICKNESS_M
    half = PAD_WIDTH_M / 2
    top = -(FINGER_LENGTH_M - TIP_BEYOND_TCP_M)
    carriage_inner, carriage_outer = inner - 0.002, inner - 0.002 + 2 * CARRIAGE_HALF_M[0]
    carriage_half, carriage_bottom = CARRIAGE_HALF_M[1], top + 2 * CARRIAGE_HALF_M[2]
    palm_x, palm_y, _ = PALM_HALF_M
    return np.array(
        [
            [[-outer, -half, top], [-inner, half, TIP_BEYOND_TCP_M]],
            [[inner, -half, top], [outer, half, TIP_BEYOND_TCP_M]],
            [[-carriage_outer, -carriage_half, top], [-carriage_inner, carriage_half, carriage_bottom]],
            [[carriage_inner, -carriage_half, top], [carriage_outer, carriage_half, carriage_bottom]],
            [[-palm_x, -palm_y, -TCP_Z_M], [palm_x, palm_y, top]],
        ]
    )
