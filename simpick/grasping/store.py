"""Storage of verified grasps: shipped with the package for library parts, cached on disk for all others."""

from __future__ import annotations

import logging
from dataclasses import astuple
from pathlib import Path

import numpy as np
from jaxtyping import Float

import simpick.assets
from simpick.assets.grippers import get_gripper
from simpick.assets.part import Part
from simpick.caching import cache_dir, cache_key, numbers, stored_arrays, write_arrays
from simpick.geometry.transforms import matrix_from_quaternion, quaternion_from_matrix, transform
from simpick.records import Grasp

_LOG = logging.getLogger(__name__)

GRASP_VERSION = 1
"""Raise it when grippers, sampling or verification change such that stored grasps no longer hold."""

_RECIPE_OPENING_M = 0.04
_FIELDS = {"recipe", "signature", "position_m", "quaternion", "width_m", "quality"}


def recipe(gripper_name: str) -> str:
    """Return a key of everything but the part that verified grasps depend on."""
    gripper = get_gripper(gripper_name)
    boxes = gripper.boxes(min(_RECIPE_OPENING_M, gripper.max_opening_m))
    settings = (astuple(gripper.sampling), astuple(gripper.hold_test))
    return cache_key(GRASP_VERSION, gripper_name, np.round(boxes, 6).tobytes(), repr(settings))


def shape_signature(part: Part) -> Float[np.ndarray, "13"]:
    """Return extents, mass, centre of mass and inertia in mm and grams: equal to a part in a thousand is equal.

    Shipped grasps are recognised by it rather than by `Part.content_hash`, which changes with the last bit of a
    vertex and so with the version of the geometry library that builds the part.
    """
    inertia = np.asarray(part.solid.moment_inertia)[np.triu_indices(3)] * part.density_kg_m3 * 1e9
    centre = np.asarray(part.solid.center_mass) * 1e3
    return np.concatenate([part.extents_m * 1e3, [part.mass_kg * 1e3], centre, inertia])


def shipped_path(part_name: str, gripper: str) -> Path:
    """Return the file that ships with the package for a library part of this name, whether or not it exists."""
    return Path(simpick.assets.__path__[0]) / "grasps" / f"{part_name}_{gripper}.npz"


def cached_path(part: Part, gripper: str) -> Path:
    """Return the cache's file for this part."""
    return cache_dir() / "grasps" / f"{part.content_hash}-{recipe(gripper)}.npz"


def load_grasps(part: Part, gripper: str) -> list[Grasp] | None:
    """Return the stored grasps of `part`, or None if there are none that fit it."""
    shipped = load_file(shipped_path(part.name, gripper), part, gripper)
    return shipped if shipped is not None else load_file(cached_path(part, gripper), part, gripper)


def save_grasps(path: Path, part: Part, gripper: str, grasps: list[Grasp]) -> None:
    """Write grasps to `path` in one step. Raises `OutputError` where that folder cannot be written."""
    Ts = np.stack([g.T_part_tcp for g in grasps]) if grasps else np.zeros((0, 4, 4))
    content = {
        "recipe": np.array(recipe(gripper)),
        "signature": shape_signature(part),
        "position_m": Ts[:, :3, 3].astype(np.float32),
        "quaternion": quaternion_from_matrix(Ts[:, :3, :3]).astype(np.float32),
        "width_m": np.array([g.width_m for g in grasps], np.float32),
        "quality": np.array([g.quality for g in grasps], np.float32),
    }
    write_arrays(path, content)


def load_file(path: Path, part: Part, gripper: str) -> list[Grasp] | None:
    """Return a file's grasps, or None if it is missing, damaged, of another recipe or of another shape.

    Arrays of other kinds or shapes than grasps have are noted in the log.
    """
    file = stored_arrays(path, _FIELDS)
    if file is None or str(file["recipe"]) != recipe(gripper):
        return None
    try:
        signature = numbers(file, "signature", "f", 13)
        count = len(numbers(file, "width_m", "f", None))
        position_m, quaternion = numbers(file, "position_m", "f", count, 3), numbers(file, "quaternion", "f", count, 4)
        quality = numbers(file, "quality", "f", count)
        if not (np.abs(np.linalg.norm(quaternion, axis=1) - 1) < 1e-3).all():
            raise ValueError("quaternion must hold rotations, of norm 1")
    except ValueError as error:
        _LOG.warning("note: %s holds no grasps (%s); they are made again", path, error)
        return None
    own = shape_signature(part)
    if not (np.abs(signature - own) < 1e-3 * np.abs(own) + 0.01).all():
        return None
    Ts = transform(matrix_from_quaternion(quaternion), np.asarray(position_m, float))
    rows = zip(Ts, file["width_m"], quality, strict=True)
    return [Grasp(T, float(width), float(score)) for T, width, score in rows]
