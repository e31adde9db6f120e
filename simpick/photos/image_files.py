"""Images of files, folders and videos as 8-bit RGB, upright as EXIF says, or why that is not possible."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Shaped, UInt8

from simpick.closing import Closing
from simpick.errors import ImageFileError

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp", ".pgm", ".ppm")
"""Images that are read."""
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm")
"""Videos that are read."""
_FOREIGN = {
    ".heic": "HEIC", ".heif": "HEIF", ".avif": "AVIF", ".dng": "camera raw", ".cr2": "camera raw",
    ".nef": "camera raw", ".arw": "camera raw", ".exr": "OpenEXR", ".hdr": "Radiance HDR", ".gif": "GIF",
}  # fmt: skip
_UPRIGHT = cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH
_AS_STORED = _UPRIGHT | cv2.IMREAD_IGNORE_ORIENTATION


@dataclass(frozen=True, eq=False)
class ImageFile:
    """One image to be read: a file, or a frame of a video."""

    path: Path
    name: str
    """Unique among the images of one call; names of output files are made of it."""
    frame: int | None = None
    """Number of the video's frame; None for an image file."""

    def __str__(self) -> str:
        return str(self.path) if self.frame is None else f"{self.path}, frame {self.frame}"


@dataclass(frozen=True, eq=False)
class Photo:
    """An image that was read."""

    rgb: UInt8[np.ndarray, "height width 3"]
    notes: tuple[str, ...] = ()
    """Sentences: what was done with depth of colour, channels and orientation."""


def find_images(paths: Sequence[Path], *, every: int = 1) -> list[ImageFile]:
    """Return the images of files, folders and videos, in the order given; folders and videos in their own order.

    Of videos every `every`-th frame is taken. Names are file stems, with a number where two are the same.

    Raises:
        ImageFileError: a path does not exist, a folder has no image, or a file is of another type.
    """
    found: list[tuple[Path, str, int | None]] = []
    for path in paths:
        if path.is_dir():
            inside = sorted((p for p in path.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES), key=_natural)
            if not inside:
                raise ImageFileError(f"folder {path} holds no image ({', '.join(IMAGE_SUFFIXES)})")
            found += [(p, p.stem, None) for p in inside]
        elif not path.is_file():
            raise ImageFileError(f"no image, video or folder {path}. Check the path")
        elif path.suffix.lower() in VIDEO_SUFFIXES:
            found += [(path, f"{path.stem}_{frame:06d}", frame) for frame in range(0, _frame_count(path), every)]
        else:
            _check_suffix(path)
            found.append((path, path.stem, None))
    names: dict[str, int] = {}
    images = []
    for path, stem, frame in found:
        names[stem] = names.get(stem, 0) + 1
        images.append(ImageFile(path, stem if names[stem] == 1 else f"{stem}-{names[stem]}", frame))
    return images


class ImageReader(Closing):
    """Reads images; a video stays open from frame to frame, so that frames in order are decoded once."""

    def __init__(self) -> None:
        self._video: cv2.VideoCapture | None = None
        self._path: Path | None = None
        self._next = 0

    def read(self, image: ImageFile, size: tuple[int, int] | None = None) -> Photo:
        """Return an image as 8-bit RGB.

        It is turned upright as its EXIF orientation says, which is how image viewers show it and OpenCV reads it; but
        where only the image as stored has the calibration's `size` (width, height), it stays as stored.

        Raises:
            ImageFileError: the image is missing, truncated or damaged, or has values that are no colours.
        """
        if image.frame is not None:
            return Photo(self._frame(image.path, image.frame, str(image)))
        content = _read_bytes(image.path)
        values, stored = (_decode(content, flags, image.path) for flags in (_UPRIGHT, _AS_STORED))
        notes = []
        if stored.shape != values.shape:
            if size is not None and values.shape[1::-1] != size and stored.shape[1::-1] == size:
                values = stored
                notes.append("kept as stored, not turned as EXIF says, because the camera has that size")
            else:
                notes.append("turned upright as its EXIF orientation says; the camera must suit that")
        elif not np.array_equal(stored, values):
            notes.append("turned by 180 degrees or mirrored as its EXIF orientation says; the camera must suit that")
        rgb, note = _eight_bits(values, str(image))
        return Photo(rgb, tuple([*notes, note] if note else notes))

    def close(self) -> None:
        """Close the video; may be called again."""
        if self._video is not None:
            self._video.release()
        self._video = self._path = None

    def _frame(self, path: Path, frame: int, name: str) -> UInt8[np.ndarray, "height width 3"]:
        if self._video is None or self._path != path or frame < self._next:
            self.close()
            self._video, self._path, self._next = cv2.VideoCapture(str(path)), path, 0
        # Decoders seek to the nearest key frame only, so frames in between are skipped one by one.
        while self._next < frame and self._video.grab():
            self._next += 1
        read, values = self._video.read() if self._next == frame else (False, None)
        self._next += 1
        if not read or values is None:
            raise ImageFileError(f"{name}: cannot be decoded; the video ends or is damaged there")
        return np.ascontiguousarray(values[..., ::-1])


def _eight_bits(
    values: Shaped[np.ndarray, "height width *channels"], name: str
) -> tuple[UInt8[np.ndarray, "height width 3"], str]:
    """Return BGR values as 8-bit RGB, with a note where values were scaled."""
    note = ""
    if values.dtype == np.uint16:
        # Industrial cameras store 10, 12 or 14 bits in 16, often without shifting them up.
        bits = next(bits for bits in (10, 12, 14, 16) if int(values.max()) < 1 << bits)
        values = (values >> (bits - 8)).astype(np.uint8)
        note = f"16-bit values, taken as {bits} bits by their maximum; the upper 8 were kept"
    if values.dtype != np.uint8:
        raise ImageFileError(f"{name}: must have 8 or 16 bits per channel, has {values.dtype}. Convert it to 8 bits")
    return np.ascontiguousarray(values[..., ::-1]), note


def _read_bytes(path: Path) -> bytes:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ImageFileError(f"cannot read image {path}: {error.strerror}") from error
    # OpenCV fills the missing rest of a truncated PNG or JPEG with grey and only prints a warning.
    whole = {b"\x89PNG": b"IEND", b"\xff\xd8": b"\xff\xd9"}
    for start, end in whole.items():
        if content.startswith(start) and end not in content[-65536:]:
            raise ImageFileError(f"{path}: the image is truncated after {len(content)} bytes. Copy it again")
    return content


def _decode(content: bytes, flags: int, path: Path) -> Shaped[np.ndarray, "height width *channels"]:
    try:
        values = cv2.imdecode(np.frombuffer(content, np.uint8), flags) if content else None
        if values is None and content:
            # Grey images of floats are read as they are only.
            values = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        values = None
    if values is None:
        raise ImageFileError(f"{path}: is no image that can be read ({len(content)} bytes); empty, damaged or foreign")
    return values


def _check_suffix(path: Path) -> None:
    suffix = path.suffix.lower()
    if suffix not in IMAGE_SUFFIXES:
        kind = f"{_FOREIGN[suffix]} is not read" if suffix in _FOREIGN else f"{suffix or 'no suffix'!r} is not read"
        known = ", ".join((*IMAGE_SUFFIXES, *VIDEO_SUFFIXES))
        raise ImageFileError(f"{path}: {kind}. Convert it to PNG or JPEG. Read are: {known}")


def _frame_count(path: Path) -> int:
    video = cv2.VideoCapture(str(path))
    count = int(video.get(cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
    video.release()
    if count < 1:
        raise ImageFileError(f"{path}: is no video that can be read, or has no frames. Convert it to MP4 (H.264)")
    return count


def _natural(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts image2 before image10."""
    return [(int(text), "") if text.isdigit() else (-1, text) for text in re.split(r"(\d+)", path.name.lower())]
