"""`Shard`: one training part seen in one bin through several cameras, with its templates, as one file."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float16, Int, UInt8

from simpick.caching import read_arrays, write_arrays
from simpick.errors import DatasetError
from simpick.geometry import ContinuousSymmetry, Pinhole, SymmetryGroup
from simpick.json_text import load_json
from simpick.rendering import TemplateSet
from simpick.rendering.templates import depth_from_steps, steps_from_depth

_FORMAT = "simpick-shard"
_VERSION = 2
_HEADER = "header.json"

OWN = 1
"""Label of the pixels that show a query's own instance."""


@dataclass(frozen=True, eq=False)
class Shard:
    """Queries of one part, and its templates."""

    part: str
    """Name of the part: ``random_<seed>``."""
    diameter_m: float
    symmetries: SymmetryGroup
    templates: TemplateSet
    rgb: UInt8[np.ndarray, "queries size size 3"]
    """Crops by virtual cameras, see `simpick.geometry.crops`; black outside the rendered image."""
    labels: UInt8[np.ndarray, "queries size size"]
    """Which instance each pixel shows: 1 is the query's own, higher numbers are its neighbours, 0 is the background."""
    relief_m: Float16[np.ndarray, "queries size size"]
    """Depth of the surface minus that of the part's origin, along the crop's axis; 0 outside the mask."""
    focal_px: Float[np.ndarray, "queries"]
    """Focal length of each crop's camera; its principal point is the crop's centre."""
    Ts_crop_part: Float[np.ndarray, "queries 4 4"]
    """True poses in the crops' cameras."""
    visible_fractions: Float[np.ndarray, "queries"]
    """Share of the instance's silhouette that is visible."""
    source_side_px: Float[np.ndarray, "queries"]
    """Longer side of the visible part's box in the rendered image, which limits the sharpness of the crop."""
    views: Int[np.ndarray, "queries"]
    """Index of the rendered image that a query was cropped from."""
    instances: Int[np.ndarray, "queries"]
    """Index of the query's instance in its bin."""

    def __len__(self) -> int:
        return len(self.rgb)

    @cached_property
    def masks(self) -> Bool[np.ndarray, "queries size size"]:
        """Return the visible part of each query's own instance."""
        return self.labels == OWN

    @property
    def crop_px(self) -> int:
        """Return the side of a crop."""
        return self.rgb.shape[1]

    def pinhole(self, query: int) -> Pinhole:
        """Return the virtual camera of one query."""
        size, f = self.crop_px, float(self.focal_px[query])
        return Pinhole(size, size, f, f, size / 2, size / 2)

    def save(self, path: Path) -> None:
        """Write the shard to one file, whole or not at all; raises OutputError.

        Every array is compressed by the fastest setting and carries a checksum. Templates' depth is rounded as
        `load_templates` rounds it, which changes nothing for rendered templates.
        """
        templates, camera = self.templates, self.templates.camera
        steps = steps_from_depth(templates.depth_m, templates.Ts_camera_part, camera)
        continuous = [[*symmetry.axis, *symmetry.offset_m] for symmetry in self.symmetries.continuous]
        arrays = {
            **{name: getattr(self, name) for name in _QUERY_ARRAYS},
            "symmetries_discrete": self.symmetries.discrete,
            "symmetries_continuous": np.array(continuous, float).reshape(-1, 6),
            "template_Ts_camera_part": templates.Ts_camera_part,
            "template_rgb": templates.rgb,
            "template_depth_steps": steps,
        }
        header = {
            "format": _FORMAT,
            "version": _VERSION,
            "part": self.part,
            "diameter_m": self.diameter_m,
            "template_camera": [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy],
            "arrays": {name: [array.dtype.str, array.shape] for name, array in arrays.items()},
        }
        write_arrays(path, {_HEADER: np.frombuffer(json.dumps(header).encode(), np.uint8)} | arrays)

    @staticmethod
    def load(path: Path) -> Shard:
        """Read a shard that `save` wrote.

        Raises:
            DatasetError: the file is missing, damaged, no shard, or of another version.
        """
        try:
            members = read_arrays(path)
            header = _read_header(path, members[_HEADER].tobytes())
            # Files of simpick 0.1 hold plain bytes.
            arrays = {
                name: members[name].view(np.dtype(kind)).reshape(shape)
                for name, (kind, shape) in header["arrays"].items()
            }
            return _from_arrays(header, arrays)
        except FileNotFoundError as error:
            raise DatasetError(f"there is no shard {path}; make it with `make_shard`") from error
        except (ValueError, KeyError, TypeError, IndexError, OverflowError, AttributeError) as error:
            if isinstance(error, DatasetError):
                raise
            raise DatasetError(f"{path} must be a whole shard, is damaged or foreign ({error}); delete it") from error


_QUERY_ARRAYS = (
    "rgb",
    "labels",
    "relief_m",
    "focal_px",
    "Ts_crop_part",
    "visible_fractions",
    "source_side_px",
    "views",
    "instances",
)


def _read_header(path: Path, content: bytes) -> dict[str, Any]:
    header = load_json(content)
    if not isinstance(header, dict) or header.get("format") != _FORMAT:
        raise DatasetError(f"{path} must be a shard of training data, has another format")
    if header.get("version") != _VERSION:
        raise DatasetError(
            f"{path} must be a shard of version {_VERSION}, got {header.get('version')}: another version of simpick"
            " wrote it; delete it, and it is made again"
        )
    return header


def _from_arrays(header: dict[str, Any], arrays: dict[str, np.ndarray]) -> Shard:
    part, diameter_m = header["part"], header["diameter_m"]
    if not isinstance(part, str) or not 0 < float(diameter_m) < math.inf:
        raise ValueError(f"it is of part {part!r} with a diameter of {diameter_m!r} m")
    camera = Pinhole(*header["template_camera"])
    Ts_camera_part = arrays["template_Ts_camera_part"]
    images = len(Ts_camera_part), camera.height, camera.width
    for name, shape in (("template_rgb", (*images, 3)), ("template_depth_steps", images)):
        if arrays[name].shape != shape:
            raise ValueError(f"{name} is of shape {arrays[name].shape}, for its camera and poses it must be {shape}")
    depth_m = depth_from_steps(arrays["template_depth_steps"], Ts_camera_part, camera)
    templates = TemplateSet(part, camera, Ts_camera_part, arrays["template_rgb"], depth_m)
    continuous = tuple(ContinuousSymmetry.of(row[:3], row[3:]) for row in arrays["symmetries_continuous"])
    query_arrays = {name: arrays[name] for name in _QUERY_ARRAYS}
    symmetries = SymmetryGroup(arrays["symmetries_discrete"], continuous)
    return Shard(part, float(diameter_m), symmetries, templates, **query_arrays)
