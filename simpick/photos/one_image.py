"""`estimate`: poses of CAD parts in one photograph, from Python."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from simpick.assets.part import Part
from simpick.errors import ConfigError
from simpick.estimators.base import Detector
from simpick.estimators.detections import photo_detector
from simpick.photos.cad_poses import CadPoseEstimate
from simpick.photos.calibration import Calibration, PixelCentres
from simpick.photos.camera_files import read_calibration
from simpick.photos.image_files import ImageReader, find_images
from simpick.photos.parts import load_parts
from simpick.photos.photo_estimator import PhotoEstimator
from simpick.records import Detection


def estimate(
    image: Shaped[np.ndarray, "height width *channels"] | str | Path,
    K: Float[np.ndarray, "3 3"] | Calibration | str | Path,
    parts: Sequence[Part | str | Path] | Part | str | Path,
    *,
    mode: str = "refined",
    detections: str | Detector | Sequence[Detection] = "learned",
    pixel_centres: PixelCentres = "integer",
    count: int | None = None,
) -> list[CadPoseEstimate]:
    """Return the poses of parts in one image, the most certain first; `T_camera_cad` is in the CAD file's frame.

    `image` is RGB (OpenCV reads BGR) or grey, of 8 bits, or a file. `K` is a camera matrix, whose pixel centres are at
    integers as in OpenCV unless `pixel_centres` is "half"; a camera file; or a `Calibration`, which may have
    distortion. `parts` are mesh files, names, `Part`s, or files that `save_onboarding` wrote. `detections` are a
    detector's name, a `Detector`, or detections in the image, of which those without a mask get one from their box.
    `count` says how many of each part to report: the most certain of 4 times as many detections. Estimators and
    onboarded parts are kept for later calls.

    Raises:
        CameraFileError: the camera does not suit the image, or its file cannot be read.
        ImageFileError: the image cannot be read.
        MeshError, UnknownPartError: a part cannot be loaded.
        UnknownNameError: there is no such mode or detector.
    """
    calibration = _calibration(K, pixel_centres)
    if isinstance(image, np.ndarray):
        rgb = np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image
        if rgb.dtype != np.uint8 or rgb.shape[2:] != (3,):
            raise ConfigError(
                f"image must be of uint8, height x width x 3 (RGB) or grey, got {image.shape} of {image.dtype}"
            )
    else:
        files = find_images([Path(image)])
        if len(files) != 1:
            raise ConfigError(f"image must be one image file, got {image} with {len(files)} images")
        with ImageReader() as reader:
            rgb = reader.read(files[0], calibration.size).rgb
    listed = [parts] if isinstance(parts, Part | str | Path) else list(parts)
    estimator = _estimator(tuple(load_parts(listed)), mode)
    found = _detector(detections, counted=count is not None) if isinstance(detections, str) else detections
    height, width = rgb.shape[:2]
    return list(estimator.estimate(rgb, calibration.of_size(width, height), found, count=count).estimates)


def _calibration(K: Float[np.ndarray, "3 3"] | Calibration | str | Path, pixel_centres: PixelCentres) -> Calibration:
    if isinstance(K, Calibration):
        return K
    if isinstance(K, str | Path):
        return read_calibration(Path(K))
    return Calibration.from_K(np.asarray(K, float), pixel_centres=pixel_centres)


@lru_cache(maxsize=4)
def _estimator(parts: tuple[Part, ...], mode: str) -> PhotoEstimator:
    return PhotoEstimator(parts, mode)


@lru_cache(maxsize=4)
def _detector(name: str, *, counted: bool) -> Detector:
    return photo_detector(name, counted=counted)
