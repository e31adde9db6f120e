"""Images of random bins: what follows from the index, and what the files hold."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simpick.errors import ConfigError, DatasetError
from simpick.training.detector.bin_data import BinDataConfig, make_bin
from simpick.training.detector.bin_files import bin_file, read_view
from tests.training.detector.conftest import TINY_DATA

pytestmark = pytest.mark.render


def test_the_same_index_gives_the_same_images(tiny_bins: Path) -> None:
    path = bin_file(tiny_bins, TINY_DATA, "train", 0)
    again = make_bin(TINY_DATA, 0, "train")
    assert len(again) == TINY_DATA.views
    for k, image in enumerate(again):
        stored = read_view(path, k)
        for name in ("rgb", "ids", "fractions"):
            np.testing.assert_array_equal(getattr(stored, name), getattr(image, name))


def test_views_show_the_same_parts_in_another_light(tiny_bins: Path) -> None:
    path = bin_file(tiny_bins, TINY_DATA, "train", 0)
    first, second = read_view(path, 0), read_view(path, 1)
    assert len(first.fractions) == len(second.fractions)
    assert (first.rgb != second.rgb).any()


def test_visible_instances_have_a_share_between_0_and_1(tiny_bins: Path) -> None:
    image = read_view(bin_file(tiny_bins, TINY_DATA, "train", 0), 0)
    seen = np.unique(image.ids[image.ids > 0]).astype(int) - 1
    assert len(seen) and (image.fractions[seen] > 0).all() and (image.fractions <= 1.001).all()


def test_other_settings_and_splits_have_other_files(tmp_path: Path) -> None:
    files = {
        bin_file(tmp_path, TINY_DATA, "train", 0),
        bin_file(tmp_path, TINY_DATA, "validation", 0),
        bin_file(tmp_path, replace(TINY_DATA, curved=True), "train", 0),
        bin_file(tmp_path, replace(TINY_DATA, seed=1), "train", 0),
    }
    assert len(files) == 4


def test_a_damaged_file_is_reported(tmp_path: Path) -> None:
    (tmp_path / "bin.npz").write_bytes(b"not a bin")
    with pytest.raises(DatasetError, match=r"is missing or damaged .* delete it, and it is made again"):
        read_view(tmp_path / "bin.npz", 0)


def test_shares_that_exceed_one_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"must not exceed 1 in sum, got 0\.8 and 0\.4"):
        BinDataConfig(homogeneous_share=0.8, crowd_share=0.4)


def test_a_negative_index_is_refused() -> None:
    with pytest.raises(ConfigError, match="index of a bin must not be negative, got -1"):
        make_bin(TINY_DATA, -1, "train")
