"""Conversion between BOP's and simpick's conventions; millimetres and pixel centres are converted only here.

==============  ==========================================  ==================================================
what            BOP                                         simpick
==============  ==========================================  ==================================================
length          millimetres                                 metres
pixel centres   at integers, so ``cam_K`` has the           at integer + 0.5, so `Pinhole` has ``cx + 0.5``
                top left pixel's centre at (0, 0)           and ``cy + 0.5``
box             ``x, y`` of the first pixel, and a size     ``xyxy`` between pixel edges
model frame     as in the PLY file                          the part frame, centred on the bounding box;
                                                            ``T_model_part`` is `Part.T_cad_part`
camera pose     ``w2c``: world to camera                    ``T_world_camera``
==============  ==========================================  ==================================================

The conversions of both directions stand side by side: what the writer writes, the reader reads back exactly.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from simpick.bop.json_files import checked_list, checked_numbers, required_numbers
from simpick.errors import ConfigError, DatasetError
from simpick.geometry.pinhole import Pinhole
from simpick.geometry.symmetry import ContinuousSymmetry, SymmetryGroup
from simpick.geometry.transforms import invert, transform

MM_PER_M = 1000.0
PIXEL_CENTRE_PX = 0.5
"""simpick's coordinate of the centre of the first pixel; BOP's is 0."""

_MAX_SKEW_PX = 0.1
_MIN_TRANSLATION_MM = 10.0


def pinhole_from_bop(K: Float[np.ndarray, "3 3"], width: int, height: int, where: str) -> Pinhole:
    """Return the camera of ``cam_K``; `where` names the entry in errors.

    Raises `DatasetError` if the matrix is not that of a pinhole camera without skew, or if it belongs to an image of
    another size.
    """
    if not (np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0 and np.allclose(K[2], [0, 0, 1])):
        raise DatasetError(
            f"{where}: cam_K must be [fx, 0, cx, 0, fy, cy, 0, 0, 1] with positive fx and fy, got {K.ravel().tolist()}."
        )
    if abs(K[0, 1]) > _MAX_SKEW_PX:
        raise DatasetError(f"{where}: cam_K has a skew of {K[0, 1]:g} px; rectify the images to a camera without skew.")
    cx, cy = K[0, 2] + PIXEL_CENTRE_PX, K[1, 2] + PIXEL_CENTRE_PX
    what = f"{where}: cam_K has its principal point at ({K[0, 2]:g}, {K[1, 2]:g}) px, the image {width} x {height} px"
    _check_size(cx / width, cy / height, what)
    return Pinhole(width, height, float(K[0, 0]), float(K[1, 1]), float(cx), float(cy))


def bop_from_pinhole(camera: Pinhole) -> Float[np.ndarray, "3 3"]:
    """Return BOP's ``cam_K`` of a camera."""
    K = camera.K
    K[:2, 2] -= PIXEL_CENTRE_PX
    return K


def transform_from_bop(
    R: Float[np.ndarray, "3 3"], t_mm: Float[np.ndarray, "3"], where: str
) -> Float[np.ndarray, "4 4"]:
    """Return the transform in metres; `where` names the entry in errors. Raises `DatasetError` if R is no rotation."""
    check_rotation(R, where)
    return transform(R, t_mm / MM_PER_M)


def bop_from_transform(T_a_b: Float[np.ndarray, "4 4"]) -> tuple[list[float], list[float]]:
    """Return the rotation, row by row, and the translation in millimetres."""
    return T_a_b[:3, :3].ravel().tolist(), (T_a_b[:3, 3] * MM_PER_M).tolist()


def check_rotation(R: Float[np.ndarray, "3 3"], where: str) -> None:
    """Raise `DatasetError` unless R is a rotation, to the precision of data sets that store few digits."""
    if not (np.isfinite(R).all() and np.abs(R @ R.T - np.eye(3)).max() < 0.02 and np.linalg.det(R) > 0):
        raise DatasetError(
            f"{where} must be a rotation matrix, row by row, got {np.round(R, 4).ravel().tolist()}; check the order of "
            "its numbers, and that it contains no scale."
        )


def check_object_distance(t_mm: Float[np.ndarray, "3"], where: str) -> None:
    """Raise `DatasetError` if an object is so close to the camera that its translation must be in metres."""
    if not np.isfinite(t_mm).all() or np.linalg.norm(t_mm) < _MIN_TRANSLATION_MM:
        raise DatasetError(
            f"{where} is {np.linalg.norm(t_mm):.3g} long; BOP's translations are in millimetres, so this one seems to "
            "be in metres. Multiply the translations by 1000."
        )


def symmetries_from_bop(info: dict[str, Any], T_model_part: Float[np.ndarray, "4 4"], where: str) -> SymmetryGroup:
    """Return the symmetries of a ``models_info`` entry, conjugated into the part frame and in metres."""
    T_part_model = invert(T_model_part)
    discrete = []
    for k, values in enumerate(checked_list(info.get("symmetries_discrete") or [], f"{where}: symmetries_discrete")):
        S = checked_numbers(values, 16, f"{where}: symmetries_discrete[{k}]").reshape(4, 4)
        check_rotation(S[:3, :3], f"{where}: symmetries_discrete[{k}]")
        S[:3, 3] /= MM_PER_M
        discrete.append(T_part_model @ S @ T_model_part)
    continuous = []
    for k, entry in enumerate(checked_list(info.get("symmetries_continuous") or [], f"{where}: symmetries_continuous")):
        axis, offset = (
            required_numbers(entry, key, 3, f"{where}: symmetries_continuous[{k}]") for key in ("axis", "offset")
        )
        if not np.linalg.norm(axis) > 0:
            raise DatasetError(f"{where}: symmetries_continuous[{k}] must have an axis that is not 0.")
        axis_part = T_part_model[:3, :3] @ (axis / np.linalg.norm(axis))
        offset_part = T_part_model[:3, :3] @ (offset / MM_PER_M) + T_part_model[:3, 3]
        try:
            continuous.append(ContinuousSymmetry.of(axis_part, offset_part))
        except ConfigError as error:
            raise DatasetError(f"{where}: symmetries_continuous[{k}]: {error}.") from error
    try:
        return SymmetryGroup(np.array(discrete).reshape(-1, 4, 4), tuple(continuous))
    except ConfigError as error:
        raise DatasetError(f"{where}: symmetries_discrete: {error}.") from error


def bop_from_symmetries(group: SymmetryGroup, T_model_part: Float[np.ndarray, "4 4"]) -> dict[str, Any]:
    """Return the entries ``symmetries_discrete`` and ``symmetries_continuous``, each only if it is not empty."""
    entries: dict[str, Any] = {}
    if len(group.discrete):
        Ss = T_model_part @ group.discrete @ invert(T_model_part)
        Ss[:, :3, 3] *= MM_PER_M
        entries["symmetries_discrete"] = [S.ravel().tolist() for S in Ss]
    if group.continuous:
        R, t = T_model_part[:3, :3], T_model_part[:3, 3]
        entries["symmetries_continuous"] = [
            {"axis": (R @ s.axis).tolist(), "offset": ((R @ s.offset_m + t) * MM_PER_M).tolist()}
            for s in group.continuous
        ]
    return entries


def check_rigid(T_model_part: Float[np.ndarray, "4 4"], name: str) -> None:
    """Raise `ConfigError` if a part's CAD frame cannot be BOP's model frame."""
    R = T_model_part[:3, :3]
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-9 or np.linalg.det(R) < 0:
        raise ConfigError(
            f"T_cad_part of part {name!r} must be rigid, in metres, got {T_model_part.tolist()}; move the scale into "
            "the mesh."
        )


def principal_point_contradicts(u: float, v: float) -> bool:
    """Return whether a principal point, as fractions of width and height, implies another image size.

    Crops move the principal point, so only two cases count: a point at the border or beyond, and one that is off centre
    by the same large factor in both directions, as when images were resized without their camera matrix.
    """
    at_border = not (0.02 < u < 0.98 and 0.02 < v < 0.98)
    resized = abs(u - v) < 0.03 and not 0.3 < (u + v) / 2 < 0.7
    return at_border or resized


def _check_size(u: float, v: float, what: str) -> None:
    """Raise `DatasetError` if the principal point implies another image size."""
    if principal_point_contradicts(u, v):
        raise DatasetError(
            f"{what}: they do not belong together. If the images were resized, scale fx, fy, cx and cy by the same "
            "factor; if they were cropped, subtract the crop's corner from cx and cy."
        )
