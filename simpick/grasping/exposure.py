"""Share of each part that is exposed to a gripper from above."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from simpick.grasping.height_grid import HeightGrid

_BELOW_M = 0.003


def exposures(points_world: Sequence[Float[np.ndarray, "_ 3"]]) -> Float[np.ndarray, "parts"]:
    """Return for each part the share of its outline, seen from above, that no other part covers.

    `points_world` are points on each part's surface, about as dense as the 4 mm grid on which heights are compared.
    """
    if not points_world:
        return np.zeros(0)
    tops = HeightGrid.around(points_world).tops(points_world)
    # A part may be its own cover: it is then the highest, and exposed.
    own = tops > -np.inf
    exposed = own & (tops >= tops.max(axis=0) - _BELOW_M)
    cells, open_cells = (np.array([np.count_nonzero(part) for part in mask]) for mask in (own, exposed))
    return np.divide(open_cells, cells, out=np.zeros(len(tops)), where=cells > 0)
