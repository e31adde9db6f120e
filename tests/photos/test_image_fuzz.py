"""Whatever an image or a video holds: 8-bit RGB, or an error that names the file."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simpick.errors import ImageFileError
from simpick.photos.image_files import ImageReader, find_images
from tests.damage import FUZZ, damaged_bytes, refusing, restored

SUFFIXES = (".png", ".jpg", ".tif", ".bmp", ".webp", ".pgm")
RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("images")
    grey = RNG.integers(0, 255, (9, 12), np.uint8)
    for suffix in SUFFIXES:
        assert cv2.imwrite(str(path / f"a{suffix}"), grey if suffix == ".pgm" else np.dstack([grey] * 3))
    assert cv2.imwrite(str(path / "deep.png"), grey.astype(np.uint16) << 4)
    video = cv2.VideoWriter(str(path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for _ in range(3):
        video.write(RNG.integers(0, 255, (48, 64, 3), np.uint8))
    video.release()
    return path


@FUZZ
@given(data=st.data(), name=st.sampled_from([*(f"a{suffix}" for suffix in SUFFIXES), "deep.png", "v.avi"]))
def test_damaged_images(folder: Path, data: st.DataObject, name: str) -> None:
    file = folder / name
    with restored(file) as whole:
        file.write_bytes(data.draw(damaged_bytes(whole)))
        with refusing(ImageFileError, name), ImageReader() as reader:
            for image in find_images([file])[:5]:
                rgb = reader.read(image, (12, 9)).rgb
                assert rgb.dtype == np.uint8 and rgb.ndim == 3 and rgb.shape[2] == 3 and rgb.size
