"""Whatever a shard's file holds: the same shard, a whole one, or an error that names it."""

from __future__ import annotations

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from simpick.caching import read_arrays, write_arrays
from simpick.errors import DatasetError
from simpick.training.data.shard import Shard
from simpick.training.detector.bin_files import read_view
from tests.damage import FUZZ, damaged_bytes, damaged_value, refusing, restored

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def file(tiny_shard: Shard, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("shards") / "a.shard"
    tiny_shard.save(path)
    return path


@FUZZ
@given(data=st.data())
def test_damaged_shards(file: Path, tiny_shard: Shard, data: st.DataObject) -> None:
    with restored(file) as whole:
        file.write_bytes(data.draw(damaged_bytes(whole)))
        with refusing(DatasetError, file.name):
            found = Shard.load(file)
            np.testing.assert_array_equal(found.rgb, tiny_shard.rgb)
            np.testing.assert_array_equal(found.Ts_crop_part, tiny_shard.Ts_crop_part)


@FUZZ
@given(data=st.data())
def test_edited_headers_of_shards(file: Path, data: st.DataObject) -> None:
    with restored(file):
        arrays = read_arrays(file)
        header = data.draw(damaged_value(json.loads(arrays["header.json"].tobytes())))
        write_arrays(file, arrays | {"header.json": np.frombuffer(json.dumps(header).encode(), np.uint8)})
        with refusing(DatasetError, file.name):
            found = Shard.load(file)
            assert isinstance(found.part, str) and 0 < found.diameter_m < math.inf
            assert all(len(getattr(found, name)) == len(found) for name in ("labels", "focal_px", "Ts_crop_part"))
            assert found.templates.rgb.shape[1:3] == (found.templates.camera.height, found.templates.camera.width)


@pytest.mark.parametrize(("place", "value"), [(0, 1), (1, 31)])
def test_a_camera_of_another_size_than_the_templates_is_refused(file: Path, place: int, value: int) -> None:
    with restored(file):
        arrays = read_arrays(file)
        header = json.loads(arrays["header.json"].tobytes())
        header["template_camera"][place] = value
        write_arrays(file, arrays | {"header.json": np.frombuffer(json.dumps(header).encode(), np.uint8)})
        with pytest.raises(DatasetError, match="for its camera and poses it must be"):
            Shard.load(file)


@FUZZ
@given(data=st.data())
def test_damaged_bins_of_the_detector(tmp_path: Path, data: st.DataObject) -> None:
    file = tmp_path / "train-x-00000.npz"
    rgb, ids = (cv2.imencode(".png", np.full(shape, 7, np.uint8))[1] for shape in ((6, 8, 3), (6, 8)))
    np.savez(file, rgb0=rgb, ids0=ids, fractions0=np.ones(2))
    file.write_bytes(data.draw(damaged_bytes(file.read_bytes())))
    with refusing(DatasetError, file.name):
        image = read_view(file, 0)
        assert (image.rgb == 7).all() and image.rgb.shape == (6, 8, 3) and (image.ids == 7).all()
