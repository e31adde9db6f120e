"""Poses as JSON and CSV, in the CAD file's own frame and unit."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simpick.assets.cad_import import is_mesh_path
from simpick.assets.part import Part
from simpick.assets.units import METRES_PER_UNIT, Unit, other_lengths, split_unit
from simpick.caching import atomic_write_text
from simpick.photos.cad_poses import CadPoseEstimate
from simpick.photos.photo_estimator import PhotoPoses
from simpick.photos.pose_checks import PoseChecks

FORMAT = "simpick poses 1"
CSV_HEADER = (
    "image", "part", "score", "probability", "R", "t", "unit", "edge_agreement", "mask_agreement", "reasons", "time_s",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class ImageAnswer:
    """What is written about one image."""

    file: str
    name: str
    poses: PhotoPoses | None
    """None where the image could not be answered."""
    checks: Sequence[PoseChecks]
    """One for each estimate."""
    notes: Sequence[str]
    error: str = ""
    """Why there is no answer."""


class PoseFiles:
    """Collects the answers to images, without the images, and writes them."""

    def __init__(self, parts: Sequence[Part], mode: str, *, probabilities: bool) -> None:
        """Take the parts that were looked for; `probabilities` states whether scores are probabilities."""
        self._parts = {part.name: part for part in parts}
        self._mode, self._probabilities = mode, probabilities
        self._images: list[dict[str, Any]] = []
        self._rows: list[list[Any]] = []

    def add(self, answer: ImageAnswer) -> None:
        """Keep what is written about an image."""
        self._images.append(_image(answer, self._probabilities))
        if answer.poses is not None:
            for estimate, checks in zip(answer.poses.estimates, answer.checks, strict=True):
                self._rows.append(self._row(answer, estimate, checks, sum(answer.poses.timings_s.values())))

    def write(self, folder: Path) -> None:
        """Write ``poses.json`` and ``poses.csv``; in the CSV, R row by row and t are separated by spaces, as in BOP.

        Raises:
            OutputError: the folder cannot be written.
        """
        convention = "p_camera = R p_cad + t; camera axes x right, y down, z forward (OpenCV); t in the unit stated"
        units = {
            name: {"unit": unit_name(part), "metres_per_unit": part.metres_per_cad_unit}
            for name, part in self._parts.items()
        }
        content = {"format": FORMAT, "mode": self._mode, "convention": convention, "parts": units}
        text = json.dumps(content | {"images": self._images}, indent=1, allow_nan=False)
        atomic_write_text(folder / "poses.json", text + "\n")
        table = io.StringIO()
        csv.writer(table, lineterminator="\n").writerows([CSV_HEADER, *self._rows])
        atomic_write_text(folder / "poses.csv", table.getvalue())

    def _row(self, answer: ImageAnswer, estimate: CadPoseEstimate, checks: PoseChecks, time_s: float) -> list[Any]:
        T, score = estimate.T_camera_cad_units, float(estimate.score)
        return [
            answer.file,
            estimate.part,
            score,
            score if self._probabilities else "",
            _join(T[:3, :3]),
            _join(T[:3, 3]),
            unit_name(self._parts[estimate.part]),
            _or_none(checks.edge_agreement),
            _or_none(checks.mask_agreement),
            "; ".join(checks.reasons),
            round(time_s, 4),
        ]


def unit_name(part: Part) -> str:
    """Return the name of the unit of a part's CAD file."""
    scale = part.metres_per_cad_unit
    return next((name for name, value in METRES_PER_UNIT.items() if math.isclose(value, scale)), f"{scale:g} m")


def describe_part(part: Part, given: str, unit: Unit) -> str:
    """Return a part's size and unit; of a mesh file whose unit was guessed, also its length in other units.

    `given` is the text that the part was asked for by, `unit` the option.
    """
    extents = " x ".join(f"{extent * 1e3:.1f}" for extent in part.extents_m)
    size = f"{part.name}: {extents} mm; poses in {unit_name(part)}"
    if not is_mesh_path(given):
        return size
    file, own_unit = split_unit(given)
    size += ", the unit of its file"
    others = other_lengths(float(part.extents_m.max()) / part.metres_per_cad_unit, unit_name(part))
    if unit != "auto" or own_unit != "auto" or not others:
        return size
    return f"{size} ({others}). For another unit: {file}@UNIT, or --unit"


def _image(answer: ImageAnswer, probabilities: bool) -> dict[str, Any]:
    content: dict[str, Any] = {"image": answer.file, "name": answer.name, "notes": list(answer.notes)}
    if answer.poses is None:
        return content | {"error": answer.error, "estimates": []}
    camera = answer.poses.frame.camera
    return content | {
        "error": None,
        "camera": {
            "width": camera.width, "height": camera.height, "fx": camera.fx, "fy": camera.fy,
            "cx": camera.cx - 0.5, "cy": camera.cy - 0.5, "pixel_centres": "integer",
        },
        "timings_s": {name: round(seconds, 4) for name, seconds in answer.poses.timings_s.items()},
        "detections": len(answer.poses.detections),
        "estimates": [
            _estimate(e, c, probabilities) for e, c in zip(answer.poses.estimates, answer.checks, strict=True)
        ],
    }  # fmt: skip


def _estimate(estimate: CadPoseEstimate, checks: PoseChecks, probabilities: bool) -> dict[str, Any]:
    scale = estimate.metres_per_cad_unit
    box = None if estimate.detection is None else np.round(estimate.detection.box_xyxy_px, 2).tolist()
    return {
        "part": estimate.part,
        "score": float(estimate.score),
        "probability": float(estimate.score) if probabilities else None,
        **_pose(estimate.T_camera_cad_units),
        "box_xyxy_px": box,
        "detection_score": None if estimate.detection is None else float(estimate.detection.score),
        "edge_agreement": _or_none(checks.edge_agreement),
        "mask_agreement": _or_none(checks.mask_agreement),
        "reasons": list(checks.reasons),
        "rivals": [
            {
                **_pose(np.block([[r.T_camera_cad[:3, :3], r.T_camera_cad[:3, 3:] / scale], [0.0, 0.0, 0.0, 1.0]])),
                "share_of_score": round(r.share, 4),
                "rotation_deg": round(r.rotation_deg, 2),
                "distance": r.distance_m / scale,
            }
            for r in checks.rivals
        ],
    }


def _pose(T: np.ndarray) -> dict[str, Any]:
    return {"R": T[:3, :3].tolist(), "t": T[:3, 3].tolist()}


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else round(value, 4)


def _join(values: np.ndarray) -> str:
    return " ".join(map(repr, values.ravel().tolist()))
