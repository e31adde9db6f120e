"""The suction head's dimensions and the boxes around it: for its model and for the sampling of its grasps."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from simpick.assets.grippers.base import GripperBoxes

SUCTION_RADIUS_M = 0.010
"""Radius of the foam face."""
SUCTION_TURN_SYMMETRY = 0
"""Any turn about the approach makes the same grasp."""
CELLS = 19
"""Cells in the face: one in the middle, rings of 6 and 12 around it."""
CELL_FORCE_N = 1.0
"""Holding force of one covered cell: 70 kPa over its 14 mm2."""
FOAM_REACH_M = 0.002
"""How far the foam bridges to an uneven surface."""
TCP_Z_M = 0.205
"""Distance from the base to the TCP, the centre of the unloaded face."""
BODY_RADIUS_M = 0.024
BODY_LENGTH_M = 0.085
LANCE_RADIUS_M = 0.006
HEAD_LENGTH_M = 0.012
CELL_PITCH_M = 0.0042


def _cell_centres() -> Float[np.ndarray, "cells 2"]:
    """Return where the cells lie in the face: a hexagonal pattern."""
    rows = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if abs(i + j) <= 2]
    return CELL_PITCH_M * np.array([[i + j / 2, j * np.sqrt(3) / 2] for i, j in rows])


CELL_CENTRES_M = _cell_centres()
"""Where the cells lie in the face, TCP frame."""


def suction_boxes() -> GripperBoxes:
    """Return boxes of head, lance and body in the TCP frame."""
    body_bottom = -(TCP_Z_M - BODY_LENGTH_M)
    lance, body, head = LANCE_RADIUS_M, BODY_RADIUS_M, SUCTION_RADIUS_M
    return np.array(
        [
            [[-head, -head, -HEAD_LENGTH_M], [head, head, 0.0]],
            [[-lance, -lance, body_bottom], [lance, lance, 0.0]],
            [[-body, -body, -TCP_Z_M], [body, body, body_bottom]],
        ]
    )
