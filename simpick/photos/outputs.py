"""Poses as JSON and CSV, in the CAD file's own frame and unit."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simpick.assets.part import Part
from simpick.assets.units import METRES_PER_UNIT
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


def write_json(
    path: Path, answers: Sequence[ImageAnswer], parts: Mapping[str, Part], *, mode: str, probabilities: bool
) -> None:
    """Write all answers; `probabilities` states whether scores are probabilities. Raises `OutputError`."""
    content = {
        "format": FORMAT,
        "mode": mode,
        "convention": "p_camera = R p_cad + t; camera axes x right, y down, z forward (OpenCV); t in the unit stated",
        "parts": {
            name: {"unit": unit_name(part), "metres_per_unit": part.metres_per_cad_unit} for name, part in parts.items()
        },
        "images": [_image(answer, probabilities) for answer in answers],
    }
    atomic_write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")


def write_csv(path: Path, answers: Sequence[ImageAnswer], parts: Mapping[str, Part], *, probabilities: bool) -> None:
    """Write one line per estimate; R row by row and t are separated by spaces, as in BOP. Raises `OutputError`."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(CSV_HEADER)
    for answer in answers:
        if answer.poses is None:
            continue
        for estimate, checks in zip(answer.poses.estimates, answer.checks, strict=True):
            T, score = estimate.T_camera_cad_units, float(estimate.score)
            rows.writerow(
                [
                    answer.file,
                    estimate.part,
                    score,
                    score if probabilities else "",
                    _join(T[:3, :3]),
                    _join(T[:3, 3]),
                    unit_name(parts[estimate.part]),
                    _or_none(checks.edge_agreement),
                    _or_none(checks.mask_agreement),
                    "; ".join(checks.reasons),
                    round(sum(answer.poses.timings_s.values()), 4),
                ]
            )
    atomic_write_text(path, text.getvalue())


def unit_name(part: Part) -> str:
    """Return the name of the unit of a part's CAD file."""
    scale = part.metres_per_cad_unit
    return next((name for name, value in METRES_PER_UNIT.items() if math.isclose(value, scale)), f"{scale:g} m")


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
