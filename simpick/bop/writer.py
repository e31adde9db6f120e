"""Writing a BOP data set, image by image.

Files are written atomically, and an image's entry in ``scene_camera.json`` comes last: a killed writer leaves a valid
data set without the unfinished image. A writer with the same folder and parts appends to it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from simpick.assets.part import Part
from simpick.bop.conventions import MM_PER_M, bop_from_pinhole, bop_from_symmetries, bop_from_transform, check_rigid
from simpick.bop.images import write_color, write_depth, write_mask
from simpick.bop.json_files import read_json, read_json_by_id
from simpick.bop.ply import ply_text
from simpick.bop.targets import MIN_VISIBLE_FRACTION
from simpick.caching import atomic_write_text
from simpick.closing import Closing
from simpick.errors import ConfigError, OutputError
from simpick.geometry.image_boxes import box_of_mask
from simpick.geometry.transforms import invert, transform_points
from simpick.records import CameraFrame

_FORMAT = "simpick BOP export 1"
_EVAL_EDGE_SHARE = 0.07
"""Longest edge of the evaluation models as a share of the diameter: BOP's are resampled to about that density."""
_NO_BOX = [-1, -1, -1, -1]


@dataclass(frozen=True, eq=False)
class BopInstance:
    """One part instance in one image, to be written as ground truth."""

    part: str
    """Name of one of the writer's parts."""
    T_camera_part: Float[np.ndarray, "4 4"]
    mask: Bool[np.ndarray, "height width"]
    """The whole silhouette inside the image, as if nothing occluded it."""
    visible_mask: Bool[np.ndarray, "height width"]
    silhouette_px: int | None = None
    """Pixels of the silhouette, also outside the image, the denominator of ``visib_fract``; None: the mask's."""


class BopWriter(Closing):
    """Writes images of known parts as a BOP data set; a context manager.

    Args:
        root: the data set's folder; new, empty, or previously written with the same parts.
        parts: all parts that may occur; their object ids are 1, 2, ... in this order.
        split: name of the folder of scenes.
        depth_scale_mm: millimetres per step of the depth images, whose 16 bits hold up to 65535 steps.
        color_format: ``png`` (lossless) or ``jpg``.

    Raises `OutputError` if the folder holds anything else.
    """

    def __init__(
        self,
        root: Path | str,
        parts: Sequence[Part],
        *,
        split: str = "test",
        depth_scale_mm: float = 0.1,
        color_format: Literal["png", "jpg"] = "png",
    ) -> None:
        if not depth_scale_mm > 0:
            raise ConfigError(f"depth_scale_mm must be positive, got {depth_scale_mm}; 0.1 reaches 6.5 m.")
        self.root, self.split, self.depth_scale_mm, self.color_format = Path(root), split, depth_scale_mm, color_format
        self.obj_ids = {part.name: k for k, part in enumerate(parts, start=1)}
        if not parts or len(self.obj_ids) != len(parts):
            raise ConfigError(f"parts must be one or more with different names, got {[part.name for part in parts]}.")
        for part in parts:
            check_rigid(part.T_cad_part, part.name)
        self._parts = {part.name: part for part in parts}
        self._open(parts)

    def check_new(self, scene_ids: Sequence[int]) -> None:
        """Raise `OutputError` if any of these scenes exists already: adding would duplicate its images."""
        old = [k for k in scene_ids if (self.root / self.split / f"{k:06d}" / "scene_camera.json").exists()]
        if old:
            raise OutputError(
                f"{self.root} has scenes {', '.join(map(str, old))} already; choose another folder or other scenes "
                "(seeds)."
            )

    def add(self, scene_id: int, frame: CameraFrame, instances: Sequence[BopInstance]) -> int:
        """Write one image of a scene and return its id, the next free one of the scene."""
        scene = self.root / self.split / f"{scene_id:06d}"
        height, width = frame.rgb.shape[:2]
        for instance in instances:
            self._check(instance, height, width)
        if (frame.camera.height, frame.camera.width) != (height, width):
            size = f"{frame.camera.width} x {frame.camera.height}"
            raise ConfigError(
                f"the frame's camera must have the image's size {width} x {height} px, got {size}; scale it."
            )
        tables = {name: _read_table(scene / f"{name}.json") for name in ("scene_gt", "scene_gt_info", "scene_camera")}
        im_id = max(tables["scene_camera"], default=-1) + 1

        for stale in (*scene.glob(f"mask/{im_id:06d}_*.png"), *scene.glob(f"mask_visib/{im_id:06d}_*.png")):
            stale.unlink()  # Left by a writer that was killed while writing this image.
        write_color(scene / "rgb" / f"{im_id:06d}.{self.color_format}", frame.rgb)
        if frame.depth_m is not None:
            write_depth(scene / "depth" / f"{im_id:06d}.png", frame.depth_m, self.depth_scale_mm)
        infos = []
        for gt_id, instance in enumerate(instances):
            # The two masks may come from different renders; the silhouette includes all visible pixels.
            mask = instance.mask | instance.visible_mask
            write_mask(scene / "mask" / f"{im_id:06d}_{gt_id:06d}.png", mask)
            write_mask(scene / "mask_visib" / f"{im_id:06d}_{gt_id:06d}.png", instance.visible_mask)
            infos.append(_info(mask, instance.visible_mask, instance.silhouette_px, frame.depth_m))

        tables["scene_gt"][im_id] = [self._truth(instance) for instance in instances]
        tables["scene_gt_info"][im_id] = infos
        R, t_mm = bop_from_transform(invert(frame.T_world_camera))
        K = bop_from_pinhole(frame.camera).ravel().tolist()
        tables["scene_camera"][im_id] = {
            "cam_K": K,
            "cam_R_w2c": R,
            "cam_t_w2c": t_mm,
            "depth_scale": self.depth_scale_mm,
        }
        for name, table in tables.items():
            _write_json(scene / f"{name}.json", table)
        if not (self.root / "camera.json").exists():
            values = {"fx": K[0], "fy": K[4], "cx": K[2], "cy": K[5], "width": width, "height": height}
            _write_json(self.root / "camera.json", values | {"depth_scale": self.depth_scale_mm})
        return im_id

    def close(self) -> None:
        """Write ``test_targets_bop19.json``: the instances of all finished images that are at least a tenth visible."""
        targets = []
        for scene in sorted((self.root / self.split).glob("*/scene_camera.json")):
            folder = scene.parent
            truths, infos = _read_table(folder / "scene_gt.json"), _read_table(folder / "scene_gt_info.json")
            for im_id in _read_table(scene):
                counts: dict[int, int] = {}
                for truth, info in zip(truths[im_id], infos[im_id], strict=True):
                    if info["visib_fract"] >= MIN_VISIBLE_FRACTION:
                        counts[truth["obj_id"]] = counts.get(truth["obj_id"], 0) + 1
                targets += [
                    {"im_id": im_id, "inst_count": count, "obj_id": obj_id, "scene_id": int(folder.name)}
                    for obj_id, count in sorted(counts.items())
                ]
        rows = ",\n".join("  " + json.dumps(target) for target in targets)
        atomic_write_text(self.root / "test_targets_bop19.json", f"[\n{rows}\n]\n")

    def _open(self, parts: Sequence[Part]) -> None:
        """Write the models into a new folder, or check that an existing one holds the same."""
        stamp = {
            "format": _FORMAT,
            "parts": [[part.name, part.content_hash, part.T_cad_part.tolist()] for part in parts],
        }
        path = self.root / "dataset_info.json"
        if self.root.exists() and not self.root.is_dir():
            raise OutputError(f"{self.root} is a file; give a folder for the data set.")
        if path.is_file():
            found = read_json(path, "")
            if found == stamp:
                return
            raise OutputError(
                f"{self.root} holds a data set that was not written by simpick with these parts in this order; choose "
                "another folder, or remove it first."
            )
        if self.root.is_dir() and any(entry.name not in ("models", "models_eval") for entry in self.root.iterdir()):
            raise OutputError(f"{self.root} is not empty and was not written by simpick; choose another folder.")
        for folder, edge_share in (("models", None), ("models_eval", _EVAL_EDGE_SHARE)):
            info = {self.obj_ids[part.name]: self._write_model(part, self.root / folder, edge_share) for part in parts}
            _write_json(self.root / folder / "models_info.json", info)
        _write_json(path, stamp)  # Last: a folder without it was left by a killed writer and is written again.

    def _write_model(self, part: Part, folder: Path, edge_share: float | None) -> dict[str, Any]:
        """Write a mesh in the model frame, in millimetres, and return its ``models_info`` entry."""
        mesh = part.mesh
        if edge_share is not None:
            max_edge = edge_share * part.diameter_m
            vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, max_edge)[:2]
            mesh = trimesh.Trimesh(vertices, faces, process=False)
            mesh.merge_vertices()
        vertices_mm = transform_points(part.T_cad_part, np.asarray(mesh.vertices)) * MM_PER_M
        mesh = trimesh.Trimesh(vertices_mm, mesh.faces, process=False)
        path = folder / f"obj_{self.obj_ids[part.name]:06d}.ply"
        atomic_write_text(path, ply_text(vertices_mm, mesh, part.material.rgb))
        low, size = vertices_mm.min(axis=0), np.ptp(vertices_mm, axis=0)
        entry: dict[str, Any] = {"name": part.name, "diameter": part.diameter_m * MM_PER_M}
        entry |= dict(zip(("min_x", "min_y", "min_z"), low.tolist(), strict=True))
        entry |= dict(zip(("size_x", "size_y", "size_z"), size.tolist(), strict=True))
        return entry | bop_from_symmetries(part.symmetries, part.T_cad_part)

    def _truth(self, instance: BopInstance) -> dict[str, Any]:
        part = self._parts[instance.part]
        R, t_mm = bop_from_transform(instance.T_camera_part @ invert(part.T_cad_part))
        return {"cam_R_m2c": R, "cam_t_m2c": t_mm, "obj_id": self.obj_ids[instance.part]}

    def _check(self, instance: BopInstance, height: int, width: int) -> None:
        if instance.part not in self._parts:
            raise ConfigError(
                f"part must be one of the writer's ({', '.join(self._parts)}), got {instance.part!r}; list it in parts."
            )
        for name in ("mask", "visible_mask"):
            shape = getattr(instance, name).shape
            if shape != (height, width):
                raise ConfigError(
                    f"{name} must have the image's size {width} x {height} px, got {shape[1]} x {shape[0]}."
                )


def _info(
    mask: Bool[np.ndarray, "height width"],
    visible: Bool[np.ndarray, "height width"],
    silhouette_px: int | None,
    depth_m: Float[np.ndarray, "height width"] | None,
) -> dict[str, Any]:
    """Return a ``scene_gt_info`` entry; without a depth image no pixel has a valid reading."""
    all_px, seen_px = max(int(mask.sum()), silhouette_px or 0), int(visible.sum())
    return {
        "bbox_obj": _box(mask) if seen_px else _NO_BOX,
        "bbox_visib": _box(visible),
        "px_count_all": all_px,
        "px_count_valid": 0 if depth_m is None else int((depth_m[mask] > 0).sum()),
        "px_count_visib": seen_px,
        "visib_fract": seen_px / all_px if all_px else 0.0,
    }


def _box(mask: Bool[np.ndarray, "height width"]) -> list[int]:
    """Return BOP's box ``x, y, width, height``; as in the toolkit, width is the last column minus the first."""
    if not mask.any():
        return _NO_BOX
    x0, y0, x1, y1 = box_of_mask(mask).astype(int).tolist()
    return [x0, y0, x1 - x0 - 1, y1 - y0 - 1]


def _read_table(path: Path) -> dict[int, Any]:
    return read_json_by_id(path, "") if path.is_file() else {}


def _write_json(path: Path, content: dict[Any, Any]) -> None:
    """Write an object atomically, one line per key, in the BOP toolkit's layout."""
    rows = ",\n".join(
        f"  {json.dumps(str(key))}: {json.dumps(value, sort_keys=True)}" for key, value in content.items()
    )
    atomic_write_text(path, f"{{\n{rows}\n}}\n")
