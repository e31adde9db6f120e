"""One scene folder of a BOP data set: images, cameras, true poses and masks of one camera."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from simpick.bop.conventions import check_object_distance, pinhole_from_bop, transform_from_bop
from simpick.bop.images import find_image, read_color, read_depth, read_mask
from simpick.bop.json_files import (
    checked_list,
    numbers,
    positive_number,
    read_json_by_id,
    required_id,
    required_numbers,
)
from simpick.bop.models import BopModels
from simpick.errors import DatasetError
from simpick.geometry.image_boxes import box_of_mask
from simpick.geometry.transforms import invert
from simpick.records import CameraFrame, Detection

BoxKind = Literal["bbox_visib", "bbox_obj"]
"""Boxes of ``scene_gt_info``: around the visible pixels, or around the whole object, hidden parts included."""


@dataclass(frozen=True, eq=False)
class BopTruth:
    """One annotated object instance in one image."""

    gt_id: int
    """Index of the annotation within its image."""
    obj_id: int
    part: str
    T_camera_part: Float[np.ndarray, "4 4"]
    visible_fraction: float | None
    """Visible fraction of the silhouette; None without ``scene_gt_info``."""
    visible_px: int | None
    """Visible pixels of the silhouette; None without ``scene_gt_info``."""


class BopScene:
    """A scene whose files are read on first use.

    `camera` is the suffix of multi-sensor data sets (``cam1`` of ``scene_camera_cam1.json``), empty for classic ones.
    """

    def __init__(self, folder: Path, scene_id: int, models: BopModels, camera: str = "") -> None:
        self.folder, self.scene_id, self.models, self.camera = folder, scene_id, models, camera
        self._suffix = f"_{camera}" if camera else ""
        self._shapes: dict[int, tuple[int, int]] = {}

    @property
    def im_ids(self) -> tuple[int, ...]:
        """Return the ids of the scene's images, ascending."""
        return tuple(self._cameras)

    def __iter__(self) -> Iterator[int]:
        return iter(self.im_ids)

    def frame(self, im_id: int, *, depth: bool = True) -> CameraFrame:
        """Return an image with its camera, and its depth if the scene has depth and `depth` is set.

        The camera's pose is the identity if the data set has none. Raises `DatasetError` for inconsistent data.
        """
        entry, where = self._camera_entry(im_id), self._where("scene_camera", im_id)
        rgb = read_color(self._color_path(im_id))
        height, width = self._shapes[im_id] = rgb.shape[:2]
        self._check_stated_size(entry, width, height, where)
        camera = pinhole_from_bop(required_numbers(entry, "cam_K", 9, where).reshape(3, 3), width, height, where)
        R, t = numbers(entry, ("cam_R_w2c", "R_w2c"), 9, where), numbers(entry, ("cam_t_w2c", "t_w2c"), 3, where)
        T_world_camera = np.eye(4)
        if R is not None and t is not None:
            T_world_camera = invert(transform_from_bop(R.reshape(3, 3), t, f"{where}, key 'cam_R_w2c'"))
        return CameraFrame(rgb, camera, T_world_camera, self._depth(im_id, (height, width)) if depth else None)

    def truth(self, im_id: int) -> tuple[BopTruth, ...]:
        """Return the annotated instances of an image, in the annotations' order."""
        self._camera_entry(im_id)
        where = self._where("scene_gt", im_id)
        if im_id not in self._gt:
            raise DatasetError(
                f"{where}: no entry for this image, although scene_camera has one; write an empty list if nothing is "
                "annotated."
            )
        entries, infos = checked_list(self._gt[im_id], where), self._gt_info(im_id)
        if infos is not None and len(infos) != len(entries):
            raise DatasetError(
                f"{self._where('scene_gt_info', im_id)}: has {len(infos)} entries, but scene_gt has {len(entries)}; "
                "the two must list the same instances in the same order."
            )
        return tuple(
            self._truth(k, entry, infos[k] if infos is not None else None, f"{where}, instance {k}")
            for k, entry in enumerate(entries)
        )

    def mask(self, im_id: int, gt_id: int) -> Bool[np.ndarray, "height width"]:
        """Return the whole silhouette of an instance, occluded pixels included."""
        return self._mask("mask", im_id, gt_id)

    def visible_mask(self, im_id: int, gt_id: int) -> Bool[np.ndarray, "height width"]:
        """Return the visible pixels of an instance."""
        return self._mask("mask_visib", im_id, gt_id)

    def detections(self, im_id: int, *, min_visible_fraction: float = 0.0) -> list[Detection]:
        """Return perfect detections from the annotations: visible masks, modal boxes, score 1.

        Instances with no visible pixel, or less visible than `min_visible_fraction`, are left out.
        `Detection.instance` is the annotation's index.
        """
        detections = []
        for truth in self.truth(im_id):
            if truth.visible_fraction is not None and truth.visible_fraction < min_visible_fraction:
                continue
            mask = self.visible_mask(im_id, truth.gt_id)
            if mask.any():
                detections.append(Detection(truth.part, box_of_mask(mask), mask, 1.0, truth.gt_id))
        return detections

    def boxes(self, im_id: int, kind: BoxKind) -> list[Detection]:
        """Return detections without masks from the annotations' boxes, score 1; those without a visible pixel left out.

        Raises `DatasetError` where ``scene_gt_info`` lacks them.
        """
        infos, where = self._gt_info(im_id), self._where("scene_gt_info", im_id)
        if infos is None:
            raise DatasetError(f"{where}: no entry; boxes of annotations need it. Give a detections file.")
        detections = []
        for truth in self.truth(im_id):
            x, y, width, height = required_numbers(infos[truth.gt_id], kind, 4, f"{where}, instance {truth.gt_id}")
            if width >= 0 and height >= 0:
                # As the toolkit computes it, the width is the last column minus the first.
                box = np.array([x, y, x + width + 1, y + height + 1])
                detections.append(Detection(truth.part, box, None, 1.0, truth.gt_id))
        return detections

    @property
    def has_truth(self) -> bool:
        """Return whether the scene has annotations; test sets of some data sets withhold them."""
        return self._file("scene_gt").is_file()

    @cached_property
    def _cameras(self) -> dict[int, Any]:
        remedy = "Choose the split and camera that the folder has, or fetch the scene again."
        return read_json_by_id(self._file("scene_camera"), remedy)

    @cached_property
    def _gt(self) -> dict[int, Any]:
        remedy = "Test splits of some data sets have no public annotations; choose another split, such as val."
        return read_json_by_id(self._file("scene_gt"), remedy)

    @cached_property
    def _gt_infos(self) -> dict[int, Any] | None:
        path = self._file("scene_gt_info")
        return read_json_by_id(path, "") if path.is_file() else None

    def _gt_info(self, im_id: int) -> list[Any] | None:
        infos = None if self._gt_infos is None else self._gt_infos.get(im_id)
        return None if infos is None else checked_list(infos, self._where("scene_gt_info", im_id))

    def _truth(self, gt_id: int, entry: Any, info: Any, where: str) -> BopTruth:
        obj_id = required_id(entry, "obj_id", where)
        R = required_numbers(entry, "cam_R_m2c", 9, where).reshape(3, 3)
        t_mm = required_numbers(entry, "cam_t_m2c", 3, where)
        check_object_distance(t_mm, f"{where}, key 'cam_t_m2c'")
        T_camera_model = transform_from_bop(R, t_mm, f"{where}, key 'cam_R_m2c'")
        part = self.models.part(obj_id)
        fraction = None if info is None else numbers(info, "visib_fract", 1, where)
        if fraction is not None and not 0 <= fraction[0] <= 1:
            raise DatasetError(f"{where}: visib_fract of scene_gt_info must be from 0 to 1, got {fraction[0]:g}.")
        pixels = None if info is None else numbers(info, "px_count_visib", 1, where)
        if pixels is not None and pixels[0] < 0:
            raise DatasetError(f"{where}: px_count_visib of scene_gt_info must be at least 0, got {pixels[0]:g}.")
        return BopTruth(
            gt_id,
            obj_id,
            part.name,
            T_camera_model @ part.T_cad_part,
            None if fraction is None else float(fraction[0]),
            None if pixels is None else int(pixels[0]),
        )

    def _camera_entry(self, im_id: int) -> Any:
        if im_id not in self._cameras:
            raise DatasetError(
                f"{self._file('scene_camera')}: has no image {im_id}. Images: {_ranges(self.im_ids)}. Check the "
                "frame's id."
            )
        entry = self._cameras[im_id]
        if not isinstance(entry, dict):
            where = self._where("scene_camera", im_id)
            raise DatasetError(f"{where}: expected an object with cam_K, got a {type(entry).__name__}.")
        return entry

    def _color_path(self, im_id: int) -> Path:
        folders = [f"{kind}{self._suffix}" for kind in ("rgb", "gray")]
        # HOT3D names its streams, not its sensors: scene_camera_rgb.json belongs to the folder rgb.
        folders += [self.camera] if self.camera else []
        for folder in folders:
            if path := find_image(self.folder / folder, f"{im_id:06d}"):
                return path
        raise DatasetError(
            f"{self.folder}: no image {im_id:06d} (png, jpg or tif) in {' or '.join(folders)}, although "
            f"{self._file('scene_camera').name} lists it. Fetch the scene again, or check the frame's id."
        )

    def _depth(self, im_id: int, shape: tuple[int, ...]) -> Float[np.ndarray, "height width"] | None:
        path = find_image(self.folder / f"depth{self._suffix}", f"{im_id:06d}")
        if path is None:
            return None
        where = self._where("scene_camera", im_id)
        remedy = "It is the length of one step of the depth images, in millimetres."
        depth_m = read_depth(path, positive_number(self._camera_entry(im_id), "depth_scale", where, remedy))
        self._check_shape(path, depth_m.shape, shape)
        return depth_m

    def _mask(self, kind: str, im_id: int, gt_id: int) -> Bool[np.ndarray, "height width"]:
        folder, stem = self.folder / f"{kind}{self._suffix}", f"{im_id:06d}_{gt_id:06d}"
        path = find_image(folder, stem)
        if path is None:
            raise DatasetError(
                f"no mask {folder / stem}.png. Masks are optional in BOP: fetch the data set's masks, or give "
                "detections as a JSON file."
            )
        mask = read_mask(path)
        if im_id not in self._shapes:
            self._shapes[im_id] = read_color(self._color_path(im_id)).shape[:2]
        self._check_shape(path, mask.shape, self._shapes[im_id])
        return mask

    def _check_shape(self, path: Path, shape: tuple[int, ...], expected: tuple[int, ...]) -> None:
        if shape != expected:
            raise DatasetError(
                f"{path}: has {shape[1]} x {shape[0]} px, but the colour image has {expected[1]} x {expected[0]}; use "
                "images that are aligned pixel by pixel."
            )

    @staticmethod
    def _check_stated_size(entry: Any, width: int, height: int, where: str) -> None:
        """Refuse images of another size than stated, and cameras that are not pinholes."""
        model = entry.get("cam_model") if isinstance(entry, dict) else None
        if model is not None and "cam_K" not in entry:
            kind = model.get("projection_model_type", "unknown") if isinstance(model, dict) else model
            raise DatasetError(
                f"{where}: has a 'cam_model' of type {kind} instead of 'cam_K'. simpick supports pinhole cameras only: "
                "undistort the images, and write their 'cam_K'."
            )
        stated = entry.get("width", width), entry.get("height", height)
        if stated != (width, height):
            raise DatasetError(
                f"{where}: states an image of {stated[0]} x {stated[1]} px, but the image has {width} x {height}; "
                "scale cam_K with the image."
            )

    def _file(self, name: str) -> Path:
        return self.folder / f"{name}{self._suffix}.json"

    def _where(self, name: str, im_id: int) -> str:
        return f"{self._file(name)}, image {im_id}"


def _ranges(ids: tuple[int, ...]) -> str:
    """Return ids in abbreviated form: ``0, 1, 2`` or ``0, 3, ... 995 (200 in all)``."""
    if len(ids) <= 12:
        return ", ".join(map(str, ids)) or "none"
    return f"{', '.join(map(str, ids[:4]))}, ... {ids[-1]} ({len(ids)} in all)"
