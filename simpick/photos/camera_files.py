"""Reading camera calibrations: OpenCV, ROS, BOP and RealSense, as YAML or JSON.

=========  ======================================================================  =================================
format     recognised by                                                           distortion
=========  ======================================================================  =================================
OpenCV     ``camera_matrix`` (or ``cameraMatrix``, ``K``, ``mtx``), as             ``distortion_coefficients``,
           ``cv2.FileStorage`` or calibration programs write them                  ``dist_coeffs``, ``dist``, ...
ROS        ``distortion_model``: ``camera_info`` files and messages                plumb_bob, rational_polynomial,
                                                                                   equidistant (fisheye)
BOP        ``camera.json``: ``fx``, ``fy``, ``cx``, ``cy``                         none
RealSense  ``ppx``, ``ppy``, ``fx``, ``fy``, ``model``, ``coeffs``                 none, Brown Conrady,
                                                                                   Kannala Brandt
=========  ======================================================================  =================================

All of them put the centre of the top left pixel at (0, 0).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from simpick.errors import CameraFileError
from simpick.json_text import load_json
from simpick.photos.calibration import Calibration, LensModel

_MATRIX = ("camera_matrix", "cameraMatrix", "CameraMatrix", "K", "k", "mtx", "intrinsic_matrix", "cam_K")
_DISTORTION = (
    "distortion_coefficients", "distortionCoefficients", "distCoeffs", "dist_coeffs", "dist_coeff", "dist", "D", "d",
)  # fmt: skip
_PROJECTION = ("projection_matrix", "P", "p")
_WIDTH, _HEIGHT = ("image_width", "width", "imageWidth"), ("image_height", "height", "imageHeight")
_ROS_LENSES: dict[str, LensModel] = {
    "plumb_bob": "brown_conrady", "rational_polynomial": "brown_conrady", "equidistant": "fisheye", "": "brown_conrady",
}  # fmt: skip
_REALSENSE_LENSES: dict[str, LensModel] = {
    "none": "brown_conrady", "brown_conrady": "brown_conrady", "kannala_brandt4": "fisheye",
}  # fmt: skip
_MOST_ITEMS = 1000
"""Under one key; a matrix has 16, and lenses have 14 coefficients."""
_MOST_PX = 100_000
_FORMATS = "OpenCV YAML or JSON, ROS camera_info YAML, BOP camera.json, or RealSense intrinsics as JSON"


def read_calibration(path: Path, *, rectified: bool = False) -> Calibration:
    """Return a file's calibration; `rectified` images have no distortion, and in ROS the projection matrix.

    Raises:
        CameraFileError: the file cannot be read, is of no known format, or describes a lens that is not supported.
    """
    content = _parse(path)
    # RealSense tools nest the intrinsics below the stream's name.
    nested = [value for value in content.values() if isinstance(value, dict) and "ppx" in value]
    if len(nested) == 1:
        content = nested[0]
    if "ppx" in content:
        found = _realsense(content, path)
    elif "distortion_model" in content:
        found = _ros(content, path, rectified=rectified)
    elif any(key in content for key in _MATRIX):
        found = _opencv(content, path)
    elif {"fx", "fy", "cx", "cy"} <= content.keys():
        K = _matrix_of(*(_number(content, key, path) for key in ("fx", "fy", "cx", "cy")))
        found = Calibration.from_K(K, size=_size(content, path), source=f"{path.name} (BOP)")
    else:
        keys = ", ".join(map(str, content)) or "none"
        raise CameraFileError(f"{path}: no camera matrix among its keys ({keys}). Give {_FORMATS}, or FX FY CX CY")
    return found.undistorted() if rectified else found


def _opencv(content: Mapping[str, Any], path: Path) -> Calibration:
    lens: LensModel = "fisheye" if content.get("fisheye_model") else "brown_conrady"
    return _calibration(
        _array(content, _MATRIX, (3, 3), path), _coefficients(content, path), lens, content, path, "OpenCV"
    )


def _ros(content: Mapping[str, Any], path: Path, *, rectified: bool) -> Calibration:
    model = str(content["distortion_model"])
    if model not in _ROS_LENSES:
        known = ", ".join(filter(None, _ROS_LENSES))
        raise CameraFileError(f"{path}, key 'distortion_model': must be one of {known}, got {model!r}")
    key = _PROJECTION if rectified else _MATRIX
    K = _array(content, key, (3, 4), path)[:, :3] if rectified else _array(content, key, (3, 3), path)
    return _calibration(K, _coefficients(content, path), _ROS_LENSES[model], content, path, "ROS")


def _realsense(content: Mapping[str, Any], path: Path) -> Calibration:
    K = _matrix_of(*(_number(content, key, path) for key in ("fx", "fy", "ppx", "ppy")))
    coefficients = tuple(_floats(content.get("coeffs") or [], f"{path}, key 'coeffs'"))
    named = re.sub(r"[\s_]+", "_", str(content.get("model", "none")).lower().rpartition(".")[2]).strip("_")
    if not any(coefficients):
        named, coefficients = "none", ()
    if named not in _REALSENSE_LENSES:
        raise CameraFileError(
            f"{path}, key 'model': simpick undistorts Brown Conrady and Kannala Brandt4, got {content.get('model')!r} "
            "with coefficients other than 0. Calibrate with OpenCV, or undistort the images and give --rectified"
        )
    lens = _REALSENSE_LENSES[named]
    return _calibration(K, coefficients[:4] if lens == "fisheye" else coefficients, lens, content, path, "RealSense")


def _calibration(
    K: Float[np.ndarray, "3 3"],
    distortion: tuple[float, ...],
    lens: LensModel,
    content: Mapping[str, Any],
    path: Path,
    name: str,
) -> Calibration:
    source = f"{path.name} ({name})"
    plain = Calibration.from_K(K, size=_size(content, path), source=source)
    return Calibration(
        plain.fx, plain.fy, plain.cx, plain.cy, plain.width, plain.height, lens, distortion, source
    )  # fmt: skip


def _parse(path: Path) -> dict[Any, Any]:
    try:
        text = path.read_text()
    except FileNotFoundError as error:
        raise CameraFileError(f"no camera file {path}. Give {_FORMATS}, or four numbers FX FY CX CY") from error
    except (OSError, UnicodeDecodeError) as error:
        raise CameraFileError(f"{path}: is no readable text file ({error}). Give {_FORMATS}") from error
    try:
        if path.suffix.lower() == ".json":
            content = load_json(text)
        else:
            # OpenCV's directive %YAML:1.0 is not YAML's own; ROS ends messages with the mark of a next document.
            content = next(yaml.load_all(re.sub(r"\A%YAML.*\n", "", text), _Loader), None)
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise CameraFileError(f"{path}: is neither JSON nor YAML ({' '.join(str(error).split())})") from error
    if not isinstance(content, dict):
        raise CameraFileError(f"{path}: must hold named values, got a {type(content).__name__}. Give {_FORMATS}")
    return content


class _Loader(yaml.SafeLoader):
    """Also reads OpenCV's matrices."""


def _matrix(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)


def _array(
    content: Mapping[str, Any], keys: tuple[str, ...], shape: tuple[int, int], path: Path
) -> Float[np.ndarray, "rows columns"]:
    """Return the matrix under the first of `keys` that is there: nested lists, a flat list, or OpenCV's mapping."""
    key = next((key for key in keys if key in content), None)
    if key is None:
        raise CameraFileError(f"{path}: has none of the keys {', '.join(keys)}, only {', '.join(map(str, content))}")
    values = _floats(content[key], f"{path}, key {key!r}")
    if len(values) != shape[0] * shape[1]:
        raise CameraFileError(f"{path}, key {key!r}: must have {shape[0]} x {shape[1]} numbers, got {len(values)}")
    return np.array(values).reshape(shape)


def _coefficients(content: Mapping[str, Any], path: Path) -> tuple[float, ...]:
    key = next((key for key in _DISTORTION if key in content), None)
    return () if key is None else tuple(_floats(content[key], f"{path}, key {key!r}"))


def _floats(value: Any, where: str) -> list[float]:
    """Return all numbers of a nested list; of a mapping those under ``data``."""
    if isinstance(value, dict):
        value = value.get("data")
    found: list[float] = []
    remaining = [value]
    # Aliases of YAML can make a short file hold billions of numbers, or a list that holds itself.
    for _ in range(_MOST_ITEMS):
        if not remaining:
            return found
        item = remaining.pop()
        if isinstance(item, list):
            remaining.extend(reversed(item[:_MOST_ITEMS]))
        else:
            found.append(_float(item, where))
    raise CameraFileError(f"{where}: must hold at most {_MOST_ITEMS} numbers and lists, and none that holds itself")


def _float(value: Any, where: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = float("nan")
    if not np.isfinite(number):
        raise CameraFileError(f"{where}: must hold finite numbers, got {value!r:.100}")
    return number


def _number(content: Mapping[str, Any], key: str, path: Path) -> float:
    if key not in content:
        raise CameraFileError(f"{path}: has no key {key!r}, only {', '.join(map(str, content))}")
    values = _floats(content[key], f"{path}, key {key!r}")
    if len(values) != 1:
        raise CameraFileError(f"{path}, key {key!r}: must be one number, got {len(values)}")
    return values[0]


def _size(content: Mapping[str, Any], path: Path) -> tuple[int, int] | None:
    """Return the stated width and height; None where they are not stated."""
    keys = [next((key for key in names if key in content), None) for names in (_WIDTH, _HEIGHT)]
    if None in keys:
        both = content.get("image_size") or content.get("imageSize")
        pair = both if isinstance(both, list) and len(both) == 2 else None
        values = None if pair is None else [_float(value, f"{path}, key 'image_size'") for value in pair]
    else:
        values = [_number(content, str(key), path) for key in keys]
    if values is None:
        return None
    if any(value != int(value) or not 1 <= value <= _MOST_PX for value in values):
        raise CameraFileError(
            f"{path}: width and height must be whole numbers of pixels from 1 to {_MOST_PX}, got {values}"
        )
    return int(values[0]), int(values[1])


def _matrix_of(fx: float, fy: float, cx: float, cy: float) -> Float[np.ndarray, "3 3"]:
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
