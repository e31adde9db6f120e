"""Images of a BOP data set: colour, depth and masks, as PNG, JPEG or TIFF."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, Shaped, UInt8

from simpick.bop.conventions import MM_PER_M
from simpick.caching import atomic_write_bytes
from simpick.errors import ConfigError, DatasetError

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
_DEPTH_MAX = 65535
"""Depth images have 16 bits."""


def find_image(folder: Path, stem: str) -> Path | None:
    """Return the image of this name in a folder, in any supported format; None if there is none."""
    return next((path for suffix in SUFFIXES if (path := folder / f"{stem}{suffix}").is_file()), None)


def read_color(path: Path) -> UInt8[np.ndarray, "height width 3"]:
    """Return a colour image as RGB; grey images get three equal channels, 16-bit images keep the upper 8 bits."""
    image = _read(path)
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.dtype != np.uint8:
        raise DatasetError(f"{path}: a colour image must have 8 or 16 bits per channel, has {image.dtype}.")
    if image.ndim == 2:
        return np.repeat(image[..., None], 3, axis=2)
    return np.ascontiguousarray(image[..., 2::-1])


def read_depth(path: Path, depth_scale_mm: float) -> Float[np.ndarray, "height width"]:
    """Return depth in metres, float32; 0 where there is no reading. One step of the image is `depth_scale_mm`."""
    image = _read(path)
    if image.ndim != 2:
        raise DatasetError(
            f"{path}: a depth image must have one channel, has {image.shape[2]}; is it a visualization of depth?"
        )
    return (image.astype(np.float64) * (depth_scale_mm / MM_PER_M)).astype(np.float32)


def read_mask(path: Path) -> Bool[np.ndarray, "height width"]:
    """Return a mask: true where the image is not black."""
    image = _read(path)
    return (image if image.ndim == 2 else image[..., :3].max(axis=2)) > 0


def write_color(path: Path, rgb: UInt8[np.ndarray, "height width 3"]) -> None:
    """Write a PNG (lossless) or, by the path's suffix, a JPEG of quality 95."""
    options = [cv2.IMWRITE_JPEG_QUALITY, 95] if path.suffix == ".jpg" else []
    _write(path, np.ascontiguousarray(rgb[..., ::-1]), options)


def write_depth(path: Path, depth_m: Float[np.ndarray, "height width"], depth_scale_mm: float) -> None:
    """Write depth as a 16-bit PNG in steps of `depth_scale_mm`; readings that are not finite become 0 (no reading).

    Raises `ConfigError` if a reading exceeds the range of 16 bits.
    """
    steps = np.round(
        np.nan_to_num(depth_m.astype(np.float64), nan=0.0, posinf=0.0, neginf=0.0) * MM_PER_M / depth_scale_mm
    )
    if steps.max(initial=0) > _DEPTH_MAX:
        raise ConfigError(
            f"depth must be at most {_DEPTH_MAX * depth_scale_mm / MM_PER_M:.3f} m with a depth scale of "
            f"{depth_scale_mm:g} mm, got {depth_m.max():.3f} m; raise depth_scale_mm."
        )
    _write(path, np.maximum(steps, 0).astype(np.uint16))


def write_mask(path: Path, mask: Bool[np.ndarray, "height width"]) -> None:
    """Write a mask as a PNG of 0 and 255."""
    _write(path, mask.astype(np.uint8) * 255)


def _read(path: Path) -> Shaped[np.ndarray, "height width *channels"]:
    """Return the image's raw values. Raises `DatasetError` if it is missing, truncated or not an image."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"cannot read image {path}: {error.strerror}.") from error
    # OpenCV fills the missing rest of a truncated PNG or JPEG with grey and only prints a warning.
    if content.startswith(b"\x89PNG") and b"IEND" not in content[-64:]:
        raise DatasetError(f"{path}: the PNG is truncated after {len(content)} bytes; fetch or write it again.")
    if content.startswith(b"\xff\xd8") and b"\xff\xd9" not in content[-1024:]:
        raise DatasetError(f"{path}: the JPEG is truncated after {len(content)} bytes; fetch or write it again.")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED) if content else None
    except cv2.error:
        image = None
    if image is None:
        raise DatasetError(
            f"{path}: not a readable PNG, JPEG or TIFF image ({len(content)} bytes); fetch or write it again."
        )
    return image


def _write(path: Path, image: Shaped[np.ndarray, "height width *channels"], options: list[int] | None = None) -> None:
    """Encode by the path's suffix and write atomically."""
    encoded = cv2.imencode(path.suffix, image, options or [])[1]
    atomic_write_bytes(path, encoded.tobytes())
