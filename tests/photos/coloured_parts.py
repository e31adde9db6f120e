"""How well `refined` poses parts whose own colours vary, compared with grey ones at the same poses.

``python -m tests.photos.coloured_parts`` renders five library parts alone, in grey and with four coloured bands as
vertex colours of a PLY file, each at 30 poses, with perfect masks.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

import simpick
from simpick.assets import get_part
from simpick.geometry import Pinhole, so3_exp, transform, transform_points
from simpick.photos.parts import load_parts
from simpick.records import Detection
from simpick.rendering import PartRenderer

PARTS = ("l_bracket", "crane_hook", "pillow_block", "sensor_housing", "clevis_fork")
CAMERA = Pinhole(320, 240, 480.0, 480.0, 160.0, 120.0)
CALIBRATION = CAMERA.K - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
"""The camera with integer pixel centres, as photographs come."""
BANDS = np.array([[200, 40, 40], [40, 60, 200], [230, 220, 60], [30, 30, 30]], np.uint8)
GREY = np.array([150, 150, 150], np.uint8)
POSES = 30


def errors(name: str, folder: Path, *, coloured: bool) -> Float[np.ndarray, "poses"]:
    """Return the largest distance of a surface point from its true place, over the diameter, of each pose."""
    mesh = get_part(name).mesh.copy().apply_scale(1e3)
    heights = np.asarray(mesh.triangles_center) @ np.random.default_rng(len(name)).normal(size=3)
    bands = np.digitize(heights, np.quantile(heights, [0.25, 0.5, 0.75]))
    colours = np.repeat(BANDS[bands] if coloured else np.tile(GREY, (len(bands), 1)), 3, axis=0)
    corners = np.asarray(mesh.triangles).reshape(-1, 3)
    file = folder / f"{name}_{coloured}.ply"
    faces = np.arange(len(corners)).reshape(-1, 3)
    trimesh.Trimesh(corners, faces, process=False, vertex_colors=colours).export(file)
    (part,) = load_parts([str(file)], "auto")
    rng = np.random.default_rng(7)
    low, high = (-0.02, -0.015, 0.25), (0.02, 0.015, 0.35)
    Ts = np.stack([transform(so3_exp(2 * rng.normal(size=3)), rng.uniform(low, high)) for _ in range(POSES)])
    with PartRenderer(part, CAMERA.height, CAMERA.width) as renderer:
        views = renderer.render(Ts, CAMERA, rgb=True)
    assert views.rgb is not None
    symmetries, points, result = part.symmetries.transforms(36), np.asarray(part.mesh.vertices), []
    for T, rgb, mask in zip(Ts, views.rgb, views.masks, strict=True):
        rows, columns = np.nonzero(mask)
        box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], float)
        image = np.where(mask[..., None], rgb, np.uint8(90))
        (estimate,) = simpick.estimate(
            image, CALIBRATION, file, mode="refined", detections=[Detection(part.name, box, mask, 1.0)]
        )
        seen = transform_points(estimate.T_camera_part, points)
        misses = [np.linalg.norm(seen - transform_points(T @ S, points), axis=1).max() for S in symmetries]
        result.append(min(misses) / part.diameter_m)
    return np.array(result)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        grey, coloured = (np.concatenate([errors(p, Path(name), coloured=c) for p in PARTS]) for c in (False, True))
    right = (grey < 0.1) & (coloured < 0.1)
    ratios = np.log(coloured / grey)[right]
    draws = np.random.default_rng(0).integers(0, len(ratios), (2000, len(ratios)))
    low, high = np.exp(np.percentile(np.median(ratios[draws], axis=1), [2.5, 97.5]))
    print(f"below 0.1 and 0.02 diameters: grey {(grey < 0.1).mean():.0%}, {(grey < 0.02).mean():.0%}, "
          f"coloured {(coloured < 0.1).mean():.0%}, {(coloured < 0.02).mean():.0%}")  # fmt: skip
    print(f"{right.sum()} pairs below: median {np.median(grey[right]):.4f} and {np.median(coloured[right]):.4f}, "
          f"median ratio {np.exp(np.median(ratios)):.2f} ({low:.2f} to {high:.2f})")  # fmt: skip
