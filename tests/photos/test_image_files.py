"""Images of every kind become 8-bit RGB, upright, or are refused by name."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from simpick.errors import ImageFileError
from simpick.photos.image_files import ImageReader, Photo, find_images

RGB = np.zeros((40, 60, 3), np.uint8)
RGB[:10, :20] = (250, 10, 10)
RGB[30:, 40:] = (10, 10, 250)


def written(path: Path, image: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), image[..., ::-1] if image.ndim == 3 else image)
    return path


def read(path: Path, size: tuple[int, int] | None = None) -> Photo:
    with ImageReader() as reader:
        (image,) = find_images([path])
        return reader.read(image, size)


def with_orientation(path: Path, orientation: int) -> Path:
    """Write the image as a JPEG whose EXIF data state an orientation."""
    jpeg = cv2.imencode(".jpg", RGB[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    tiff = b"II*\0" + struct.pack("<IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    exif = b"Exif\0\0" + tiff
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + jpeg[2:])
    return path


def test_colours_are_rgb(tmp_path: Path) -> None:
    assert np.array_equal(read(written(tmp_path / "a.png", RGB)).rgb, RGB)


def test_grey_images_get_three_channels_and_alpha_is_dropped(tmp_path: Path) -> None:
    grey = RGB[..., 0]
    assert np.array_equal(read(written(tmp_path / "grey.png", grey)).rgb, np.repeat(grey[..., None], 3, axis=2))
    cv2.imwrite(str(tmp_path / "alpha.png"), np.dstack([RGB[..., ::-1], grey]))
    assert np.array_equal(read(tmp_path / "alpha.png").rgb, RGB)


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_sixteen_bit_images_keep_their_upper_eight_bits(bits: int, tmp_path: Path) -> None:
    deep = RGB.astype(np.uint16) << (bits - 8)
    photo = read(written(tmp_path / "deep.png", deep))
    assert np.array_equal(photo.rgb, RGB) and f"taken as {bits} bits" in photo.notes[0]


def test_exif_turns_an_image_unless_only_the_stored_one_has_the_cameras_size(tmp_path: Path) -> None:
    path = with_orientation(tmp_path / "turned.jpg", 6)
    upright = read(path)
    assert upright.rgb.shape == (60, 40, 3) and "turned upright" in upright.notes[0]
    assert upright.rgb[2, 37, 0] > 200, "the red corner is now at the top right"
    assert read(path, (40, 60)).rgb.shape == (60, 40, 3)
    stored = read(path, (60, 40))
    assert stored.rgb.shape == (40, 60, 3) and "kept as stored" in stored.notes[0]


def test_exif_turns_an_image_by_half_a_turn(tmp_path: Path) -> None:
    photo = read(with_orientation(tmp_path / "half.jpg", 3))
    assert photo.rgb[2, 2, 2] > 200 and "180 degrees" in photo.notes[0]


def test_folders_are_read_in_natural_order_and_names_are_unique(tmp_path: Path) -> None:
    for name in ("image10.png", "image2.png", "notes.txt"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "more").mkdir()
    written(tmp_path / "more" / "image2.jpg", RGB)
    assert [f.name for f in find_images([tmp_path, tmp_path / "more"])] == ["image2", "image10", "image2-2"]


def test_videos_are_read_frame_by_frame(tmp_path: Path) -> None:
    video = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (60, 40))
    for level in range(0, 250, 50):
        video.write(np.full((40, 60, 3), level, np.uint8))
    video.release()
    frames = find_images([tmp_path / "v.avi"], every=2)
    assert [f.name for f in frames] == ["v_000000", "v_000002", "v_000004"]
    with ImageReader() as reader:
        assert [round(reader.read(f).rgb.mean() / 50) for f in [*frames, frames[0]]] == [0, 2, 4, 0]


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("empty.png", b"", "no image that can be read (0 bytes)"),
        ("text.jpg", b"hello", "no image that can be read (5 bytes)"),
        ("photo.heic", b"x", "HEIC is not read. Convert it to PNG or JPEG"),
        ("drawing.xyz", b"x", "'.xyz' is not read"),
        ("film.mp4", b"no film", "no video that can be read"),
    ],
)
def test_what_cannot_be_read_is_named(name: str, content: bytes, problem: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ImageFileError) as error:
        read(tmp_path / name)
    assert problem in str(error.value) and name in str(error.value)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_truncated_image_is_refused(suffix: str, tmp_path: Path) -> None:
    path = written(tmp_path / f"cut{suffix}", np.random.default_rng(0).integers(0, 255, (40, 60, 3), np.uint8))
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(ImageFileError, match="truncated"):
        read(path)


def test_missing_paths_and_folders_without_images_are_named(tmp_path: Path) -> None:
    with pytest.raises(ImageFileError, match="no image, video or folder"):
        find_images([tmp_path / "no.png"])
    with pytest.raises(ImageFileError, match="holds no image"):
        find_images([tmp_path])


def test_float_images_are_refused_by_name(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "f.tiff"), np.ones((8, 8), np.float32))
    with pytest.raises(ImageFileError, match="must have 8 or 16 bits per channel, has float32"):
        read(tmp_path / "f.tiff")
