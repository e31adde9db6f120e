"""The object models of a BOP data set as `Part`s, in metres and centred on their bounding boxes."""

from __future__ import annotations

import re
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float
from trimesh.visual.texture import TextureVisuals

from simpick.assets.face_colours import face_colours, vertex_colours
from simpick.assets.part import Material, Part
from simpick.bop.conventions import MM_PER_M, symmetries_from_bop
from simpick.bop.json_files import positive_number, read_json_by_id
from simpick.bop.ply import read_ply
from simpick.errors import DatasetError, MeshError
from simpick.geometry.transforms import invert, transform, transform_points

MIN_DIAMETER_MM, MAX_DIAMETER_MM = 2.0, 3000.0
"""Parts that a robot picks lie between; models in metres or micrometres do not."""

_DIAMETER_REMEDY = "It is the largest distance of two vertices, in millimetres."
_DIAMETER_TOLERANCE = 1.5
"""``models_info`` may describe the decimated mesh, so the check only detects a wrong unit."""


class BopModels:
    """The models of one data set; meshes are read on first use."""

    def __init__(self, folder: Path, eval_folder: Path | None = None) -> None:
        self.folder, self.eval_folder = folder, eval_folder or folder
        self._parts: dict[int, Part] = {}
        self._eval_parts: dict[int, Part] = {}

    @cached_property
    def info(self) -> dict[int, Any]:
        """Return ``models_info.json`` by object id."""
        return read_json_by_id(
            self.folder / "models_info.json",
            "It comes with the data set's models; fetch them or point to their folder.",
        )

    @cached_property
    def eval_info(self) -> dict[int, Any]:
        """Return the eval models' ``models_info.json``, whose diameters scale errors, as in the BOP toolkit."""
        if not (self.eval_folder / "models_info.json").is_file():
            return self.info
        return read_json_by_id(self.eval_folder / "models_info.json", "")

    @property
    def obj_ids(self) -> tuple[int, ...]:
        """Return the ids that ``models_info.json`` lists, ascending."""
        return tuple(self.info)

    def part(self, obj_id: int) -> Part:
        """Return the part of an object id; `Part.T_cad_part` maps to the model's own frame, in metres.

        The collision shape is the convex hull. Raises `DatasetError` where the mesh is missing, unreadable or not in
        millimetres.
        """
        if obj_id not in self._parts:
            self._parts[obj_id] = self._load(obj_id, self.folder)
        return self._parts[obj_id]

    def eval_part(self, obj_id: int) -> Part:
        """Return the eval model as a part: what BOP renders for VSD.

        Its bounding box, and therefore its part frame, may differ slightly from the model's; ``part.T_cad_part`` and
        ``eval_part.T_cad_part`` map to the same model frame.
        """
        if self.eval_folder == self.folder:
            return self.part(obj_id)
        if obj_id not in self._eval_parts:
            self._eval_parts[obj_id] = self._load(obj_id, self.eval_folder)
        return self._eval_parts[obj_id]

    def parts(self) -> tuple[Part, ...]:
        """Return all parts, by ascending object id."""
        return tuple(self.part(obj_id) for obj_id in self.obj_ids)

    def obj_id(self, part_name: str) -> int:
        """Return the object id of a part name. Raises `DatasetError` if there is none."""
        if part_name not in self._ids:
            raise DatasetError(f"{self.folder}: no object is named {part_name!r}. Valid: {', '.join(self._ids)}.")
        return self._ids[part_name]

    def name(self, obj_id: int) -> str:
        """Return the part's name: the one that simpick wrote to ``models_info``, or ``obj_`` and six digits."""
        self._entry(obj_id)
        return self._names[obj_id]

    def diameter_m(self, obj_id: int) -> float:
        """Return the diameter that scales BOP's thresholds, from the eval models' ``models_info.json``."""
        where = f"{self.eval_folder / 'models_info.json'}, object {obj_id}"
        entry = self.eval_info.get(obj_id, self._entry(obj_id))
        return positive_number(entry, "diameter", where, _DIAMETER_REMEDY) / MM_PER_M

    def eval_points_m(self, obj_id: int) -> Float[np.ndarray, "n 3"]:
        """Return the vertices that BOP measures errors on (the eval model's), in metres, in the part frame."""
        part, eval_part = self.part(obj_id), self.eval_part(obj_id)
        T_part_evalpart = invert(part.T_cad_part) @ eval_part.T_cad_part
        return transform_points(T_part_evalpart, np.asarray(eval_part.mesh.vertices))

    @cached_property
    def _names(self) -> dict[int, str]:
        names = {obj_id: f"obj_{obj_id:06d}" for obj_id in self.info}
        for obj_id, entry in self.info.items():
            own = entry.get("name") if isinstance(entry, dict) else None
            if isinstance(own, str) and re.fullmatch(r"\w+", own, re.ASCII) and own not in names.values():
                names[obj_id] = own
        return names

    @cached_property
    def _ids(self) -> dict[str, int]:
        return {name: obj_id for obj_id, name in self._names.items()}

    def _entry(self, obj_id: int) -> Any:
        if obj_id not in self.info:
            raise DatasetError(
                f"{self.folder / 'models_info.json'}: has no key {obj_id}, which the data set's images or results "
                f"name. Objects: {', '.join(map(str, self.obj_ids))}."
            )
        return self.info[obj_id]

    def _load(self, obj_id: int, folder: Path) -> Part:
        entry = self._entry(obj_id)
        path = folder / f"obj_{obj_id:06d}.ply"
        mesh = read_ply(path, self._present(folder))
        self._check_unit(mesh, positive_number(entry, "diameter", self._where(obj_id), _DIAMETER_REMEDY), path)
        material, colours = _material(mesh), vertex_colours(mesh)
        vertices_m = mesh.vertices / MM_PER_M
        used_m = vertices_m[np.unique(mesh.faces)]
        T_model_part = transform(translation=(used_m.min(axis=0) + used_m.max(axis=0)) / 2)
        shape = trimesh.Trimesh(transform_points(invert(T_model_part), vertices_m), mesh.faces, process=False)
        try:
            hull = shape.convex_hull
        except Exception as error:
            raise DatasetError(
                f"{path}: the mesh is flat or degenerate and has no convex hull; check the model."
            ) from error
        symmetries = symmetries_from_bop(entry, T_model_part, self._where(obj_id))
        face_rgb = None if colours is None else face_colours(mesh, colours)
        try:
            return Part(
                self._names[obj_id],
                shape,
                (hull,),
                symmetries,
                material=material,
                T_cad_part=T_model_part,
                metres_per_cad_unit=1 / MM_PER_M,
                face_rgb=face_rgb,
            )
        except MeshError as error:
            raise DatasetError(f"{path}: cannot be used as a part ({error}); check the model.") from error

    def _where(self, obj_id: int) -> str:
        return f"{self.folder / 'models_info.json'}, object {obj_id}"

    @staticmethod
    def _present(folder: Path) -> str:
        return ", ".join(path.name for path in sorted(folder.glob("obj_*.ply"))) or "none"

    @staticmethod
    def _check_unit(mesh: trimesh.Trimesh, diameter_mm: float, path: Path) -> None:
        """Raise `DatasetError` if the mesh or ``models_info`` is in another unit than millimetres.

        The true diameter lies between the longest side of the bounding box and its diagonal.
        """
        low, high = float(mesh.extents.max()), float(np.linalg.norm(mesh.extents))
        advice = "BOP models are in millimetres: multiply the vertices by 1000 if they are in metres, and "
        advice += "write models_info.json again from them."
        if not low / _DIAMETER_TOLERANCE <= diameter_mm <= high * _DIAMETER_TOLERANCE:
            raise DatasetError(
                f"{path}: the mesh's diameter is {low:.4g} to {high:.4g} (by its bounding box), but models_info.json "
                f"says {diameter_mm:.4g} mm; one of them is in another unit. {advice}"
            )
        if not (high >= MIN_DIAMETER_MM and low <= MAX_DIAMETER_MM):
            raise DatasetError(
                f"{path}: the mesh spans {low:.4g} mm, which is not the size of a part ({MIN_DIAMETER_MM:g} to "
                f"{MAX_DIAMETER_MM:g} mm). {advice}"
            )


def _material(mesh: trimesh.Trimesh) -> Material:
    """Return a material of the mesh's mean colour, in which scenes draw the part."""
    visual = mesh.visual
    try:
        if isinstance(visual, TextureVisuals):
            visual = visual.to_color()
        rgba = np.asarray(visual.vertex_colors) if visual is not None and visual.defined else np.zeros((0, 4))
    except (AttributeError, ValueError, IndexError):  # Texture coordinates without their image.
        rgba = np.zeros((0, 4))
    if rgba.ndim != 2 or len(rgba) == 0:
        return Material()
    red, green, blue = (float(c) for c in rgba[:, :3].mean(axis=0) / 255)
    return Material(rgb=(red, green, blue))
