"""Normal forces of a model's contacts."""

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float, Int


def normal_forces(
    data: mujoco.MjData, contacts: Int[np.ndarray, "contacts"] | slice = slice(None)
) -> Float[np.ndarray, "contacts"]:
    """Return the normal force (N) in these contacts, by default all; 0 where surfaces are near but do not touch."""
    # With elliptic cones the first row of a contact's constraint is its normal direction.
    rows = data.contact.efc_address[contacts]
    active = rows >= 0
    if active.all():
        return data.efc_force[rows]
    forces = np.zeros(len(rows))
    forces[active] = data.efc_force[rows[active]]
    return forces
