"""Which groups of geoms touch each other."""

from __future__ import annotations

from enum import IntEnum

import mujoco
import numpy as np
from jaxtyping import Bool, Int

from simpick.assets.grippers.base import GRIPPER_PREFIX


class ContactGroup(IntEnum):
    """What a geom belongs to."""

    TABLE = 0
    BIN = 1
    CHUTE = 2
    ARM = 3
    GRIPPER = 4
    PART = 5


_PREFIXES = {
    "bin": ContactGroup.BIN,
    "chute": ContactGroup.CHUTE,
    "arm/": ContactGroup.ARM,
    GRIPPER_PREFIX: ContactGroup.GRIPPER,
    "part_": ContactGroup.PART,
}


def group_of_geom(model: mujoco.MjModel) -> Int[np.ndarray, "geoms"]:
    """Return the contact group of every geom, by the name of its body."""
    groups = np.full(model.ngeom, ContactGroup.TABLE, np.int32)
    for geom in range(model.ngeom):
        name = model.body(model.geom_bodyid[geom]).name
        for prefix, group in _PREFIXES.items():
            if name.startswith(prefix):
                groups[geom] = group
    return groups


def contacts_between(
    data: mujoco.MjData, groups: Int[np.ndarray, "geoms"], a: ContactGroup, b: ContactGroup
) -> Bool[np.ndarray, "contacts"]:
    """Return which of `data.contact` join a geom of group `a` with one of group `b`."""
    first, second = groups[data.contact.geom].T
    return ((first == a) & (second == b)) | ((first == b) & (second == a))
