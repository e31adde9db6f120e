"""Pose estimates in BOP's results CSV: ``scene_id,im_id,obj_id,score,R,t,time``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from simpick.bop.conventions import bop_from_transform, check_object_distance, transform_from_bop
from simpick.bop.json_files import MAX_ID, MAX_NUMBER, id_from_text, number_from_text
from simpick.caching import atomic_write_text
from simpick.errors import ConfigError, DatasetError

HEADER = "scene_id,im_id,obj_id,score,R,t,time"
_TIME_TOLERANCE_S = 0.001


@dataclass(frozen=True, eq=False)
class BopResult:
    """One line: a pose estimate of one object in one image."""

    scene_id: int
    im_id: int
    obj_id: int
    score: float
    T_camera_model: Float[np.ndarray, "4 4"]
    """Pose of the model's own frame, in metres; ``T_camera_part = T_camera_model @ part.T_cad_part``."""
    time_s: float
    """For the whole image, therefore equal in all its lines; negative if unknown."""

    @property
    def is_failed(self) -> bool:
        """Return whether the method gave up: it then writes a translation of 0."""
        return not self.T_camera_model[:3, 3].any()


def read_results(path: Path) -> list[BopResult]:
    """Return a file's estimates in its order. Raises `DatasetError` naming the invalid line and field."""
    try:
        lines = path.read_text().splitlines()
    except OSError as error:
        raise DatasetError(f"cannot read {path}: {error.strerror}. Give a results CSV ({HEADER}).") from error
    except UnicodeDecodeError as error:
        raise DatasetError(f"{path}: is not a text file. Give a results CSV ({HEADER}).") from error
    results: list[BopResult] = []
    times: dict[tuple[int, int], float] = {}
    for number, line in enumerate(lines, start=1):
        if not line.strip() or (number == 1 and HEADER in line.replace(" ", "")):
            continue
        result = _parse(line, f"{path}, line {number}")
        image = result.scene_id, result.im_id
        if abs(times.setdefault(image, result.time_s) - result.time_s) > _TIME_TOLERANCE_S:
            raise DatasetError(
                f"{path}, line {number}: time is {result.time_s:g} s, but an earlier line of scene {image[0]}, image "
                f"{image[1]} has {times[image]:g} s; it is the time for the whole image, the same in all its lines."
            )
        results.append(result)
    return results


def write_results(path: Path, results: Iterable[BopResult]) -> None:
    """Write the estimates atomically, with numbers in full precision, so that reading them back is exact.

    Raises `ConfigError` if two estimates of one image have different times.
    """
    lines = [HEADER]
    times: dict[tuple[int, int], float] = {}
    for r in results:
        if abs(times.setdefault((r.scene_id, r.im_id), r.time_s) - r.time_s) > _TIME_TOLERANCE_S:
            raise ConfigError(
                f"time_s must be the same for all estimates of scene {r.scene_id}, image {r.im_id}, got "
                f"{times[r.scene_id, r.im_id]} and {r.time_s}; give the time of the whole image."
            )
        R, t_mm = bop_from_transform(r.T_camera_model)
        fields = r.scene_id, r.im_id, r.obj_id, float(r.score), _join(R), _join(t_mm), float(r.time_s)
        lines.append(",".join(map(str, fields)))
    atomic_write_text(path, "\n".join(lines) + "\n")


def _join(values: Sequence[float]) -> str:
    return " ".join(map(repr, values))


def _parse(line: str, where: str) -> BopResult:
    fields = line.split(",")
    if len(fields) != 7:
        raise DatasetError(f"{where}: must have 7 fields separated by commas ({HEADER}), has {len(fields)}.")
    names = ("scene_id", "im_id", "obj_id")
    scene_id, im_id, obj_id = (_id(field, name, where) for name, field in zip(names, fields[:3], strict=True))
    score = float(_floats(fields[3], 1, "score", where)[0])
    R = _floats(fields[4], 9, "R", where).reshape(3, 3)
    t_mm = _floats(fields[5], 3, "t", where)
    if t_mm.any():
        check_object_distance(t_mm, f"{where}: t")
        T_camera_model = transform_from_bop(R, t_mm, f"{where}: R")
    else:
        T_camera_model = np.eye(4)  # A failed estimate, whose R means nothing.
    return BopResult(scene_id, im_id, obj_id, score, T_camera_model, float(_floats(fields[6], 1, "time", where)[0]))


def _floats(field: str, count: int, name: str, where: str) -> Float[np.ndarray, "{count}"]:
    """Return the field's numbers, separated by spaces."""
    texts = field.split()
    if len(texts) != count:
        hint = ", row by row, separated by spaces" if count > 1 else ""
        raise DatasetError(f"{where}: {name} must have {count} number{'s' * (count > 1)}{hint}, has {len(texts)}.")
    try:
        values = np.array([number_from_text(text) for text in texts], float)
    except ValueError as error:
        raise DatasetError(f"{where}: {name} must be numbers, got {field.strip()[:100]!r}.") from error
    # NaN fails every comparison.
    if not (np.abs(values) <= MAX_NUMBER).all():
        raise DatasetError(f"{where}: {name} must be finite and at most {MAX_NUMBER:g}, got {field.strip()[:100]!r}.")
    return values


def _id(field: str, name: str, where: str) -> int:
    value = id_from_text(field.strip())
    if value is None:
        raise DatasetError(f"{where}: {name} must be a whole number from 0 to {MAX_ID}, got {field.strip()[:100]!r}.")
    return value
