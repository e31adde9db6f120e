"""Images of random bins: what follows from the index, and what the files hold."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from simpick.errors import ConfigError, DatasetError
from simpick.training.detector.bin_data import BinDataConfig, make_bin
from simpick.training.detector.bin_files import bin_file, read_view, write_bin
from tests.training.detector.conftest import TINY_DATA

pytestmark = pytest.mark.render


def test_the_same_index_gives_the_same_images(tiny_bins: Path) -> None:
    path = bin_file(tiny_bins, TINY_DATA, "train", 0)
    again = make_bin(TINY_DATA, 0, "train")
    assert len(again) == TINY_DATA.views
    for k, image in enumerate(again):
        stored = read_view(path, k)
        for name in ("rgb", "ids"):
            np.testing.assert_array_equal(getattr(stored, name), getattr(image, name))


def test_views_show_the_same_parts_in_another_light(tiny_bins: Path) -> None:
    path = bin_file(tiny_bins, TINY_DATA, "train", 0)
    first, second = read_view(path, 0), read_view(path, 1)
    assert first.ids.max() == second.ids.max()
    assert (first.rgb != second.rgb).any()


def test_held_out_instances_have_a_visible_share_between_0_and_1(tmp_path: Path) -> None:
    config = replace(TINY_DATA, views=1)
    write_bin(tmp_path, config, "validation", 0)
    image = read_view(bin_file(tmp_path, config, "validation", 0), 0)
    seen = np.unique(image.ids[image.ids > 0]).astype(int) - 1
    assert image.fractions is not None and len(seen)
    assert (image.fractions[seen] > 0).all() and (image.fractions <= 1.001).all()


def test_equal_parts_have_one_colour_in_the_share_of_views_that_asks_for_it() -> None:
    """Without shadows and light of its own, an image of one part's instances in one tint has few colours."""
    config = BinDataConfig(views=3, count=(4, 4), homogeneous_share=1.0, crowd_share=0.0, width_px=192, height_px=160)
    config = replace(config, strong_share=1.0, photo_share=0.0)

    def hues(share: float) -> list[float]:
        images = make_bin(replace(config, one_tint_share=share), 0, "train")
        means = [np.array([im.rgb[im.ids == k].mean(axis=0) for k in np.unique(im.ids[im.ids > 0])]) for im in images]
        return [float((m / m.sum(axis=1, keepdims=True)).std(axis=0).max()) for m in means]

    assert max(hues(1.0)) < 0.5 * max(hues(0.0))


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


@pytest.mark.parametrize("names", [("homogeneous_share", "crowd_share"), ("strong_share", "photo_share")])
def test_shares_that_exceed_one_are_refused(names: tuple[str, str]) -> None:
    with pytest.raises(ConfigError, match=rf"{names[0]} and {names[1]} must not exceed 1 in sum, got 0\.8 and 0\.4"):
        replace(BinDataConfig(), **dict(zip(names, (0.8, 0.4), strict=True)))


def test_a_negative_index_is_refused() -> None:
    with pytest.raises(ConfigError, match="index of a bin must not be negative, got -1"):
        make_bin(TINY_DATA, -1, "train")
