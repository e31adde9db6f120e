"""What a shard holds: exact poses, enough of each part, nothing of the other split, and the same anywhere."""

import hashlib
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from simpick.assets.library import get_part
from simpick.assets.library_parts import is_reserved_name, library_part_names
from simpick.assets.random_parts import random_part, seed_from_name
from simpick.errors import ConfigError
from simpick.geometry import invert, transform_points
from simpick.rendering import PartRenderer, render_templates
from simpick.training.data.data_config import DataConfig
from simpick.training.data.random_bins import random_bin, random_part_seed
from simpick.training.data.shard import Shard
from simpick.training.data.shard_factory import make_shard
from tests.training.conftest import TINY


def fingerprint(shard: Shard) -> str:
    arrays = (shard.rgb, shard.masks, shard.Ts_crop_part, shard.focal_px, shard.visible_fractions, shard.templates.rgb)
    return hashlib.sha256(b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)).hexdigest()


@pytest.mark.render
def test_true_poses_put_the_part_where_its_mask_is(tiny_shard: Shard) -> None:
    with PartRenderer(get_part(tiny_shard.part), tiny_shard.crop_px, tiny_shard.crop_px) as renderer:
        cameras = [tiny_shard.pinhole(k) for k in range(len(tiny_shard))]
        silhouettes = renderer.render(tiny_shard.Ts_crop_part, cameras, rgb=False).masks
    bare = tiny_shard.visible_fractions > 0.999
    assert bare.sum() >= 2
    for mask, silhouette, alone in zip(tiny_shard.masks, silhouettes, bare, strict=True):
        # Whatever is hidden, nothing is seen beside the silhouette but for the pixels on its edge.
        assert (mask & ~silhouette).sum() < 0.03 * silhouette.sum()
        if alone:
            assert (mask & silhouette).sum() / (mask | silhouette).sum() > 0.96


@pytest.mark.render
def test_queries_keep_the_limits_of_the_configuration(tiny_shard: Shard) -> None:
    assert 1 <= len(tiny_shard) <= TINY.queries
    assert (tiny_shard.visible_fractions >= TINY.min_visible_fraction).all()
    assert (np.bincount(tiny_shard.views) <= TINY.queries_per_camera).all()
    # The padded box fills the crop, so the visible part spans 1 / padding of it, less what perspective takes.
    columns = tiny_shard.masks.any(axis=1).sum(axis=-1)
    rows = tiny_shard.masks.any(axis=2).sum(axis=-1)
    assert np.allclose(np.maximum(columns, rows), TINY.crop_px / TINY.crop_padding, rtol=0.15)


@pytest.mark.render
def test_templates_are_those_of_the_part(tiny_shard: Shard) -> None:
    expected = render_templates(get_part(tiny_shard.part), TINY.templates)
    assert np.array_equal(tiny_shard.templates.rgb, expected.rgb)
    assert np.array_equal(tiny_shard.templates.depth_m, expected.depth_m)


@pytest.mark.render
def test_another_process_makes_the_same_shard(tiny_shard: Shard) -> None:
    code = (
        "from tests.training.conftest import TINY; from tests.training.data.test_shard_factory import fingerprint\n"
        "from simpick.training.data.shard_factory import make_shard\n"
        "print(fingerprint(make_shard(TINY, 0, split='train')))"
    )
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert other.strip() == fingerprint(tiny_shard)


@pytest.mark.render
def test_index_and_split_give_other_parts(tiny_shard: Shard) -> None:
    small = replace(TINY, queries=1)
    others = [make_shard(small, 1, split="train"), make_shard(small, 0, split="validation")]
    assert len({tiny_shard.part, *(shard.part for shard in others)}) == 3


def test_splits_share_no_part_and_none_with_the_library() -> None:
    train = {random_part_seed(np.random.default_rng(k), "train") for k in range(200)}
    validation = {random_part_seed(np.random.default_rng(k), "validation") for k in range(200)}
    assert len(train) == len(validation) == 200
    assert {seed % 2 for seed in train} == {0} and {seed % 2 for seed in validation} == {1}
    assert all(is_reserved_name(f"random_{seed}") for seed in train | validation)
    assert not {f"random_{seed}" for seed in train | validation} & set(library_part_names())


def test_a_mixed_bin_holds_others_of_the_same_split() -> None:
    config = replace(TINY, mixed_share=1.0, count=(6, 6), target_share=(0.5, 0.5), others=(2, 2))
    part = get_part("random_13")
    scene = random_bin(config, part, np.random.default_rng(3), "validation")
    names = [instance.part.name for instance in scene.instances]
    assert names[0] == part.name and 1 <= names.count(part.name) <= 3
    seeds = [seed_from_name(name) for name in names]
    assert len(set(seeds)) > 1 and all(seed is not None and seed % 2 == 1 for seed in seeds)


def test_a_negative_index_is_refused() -> None:
    with pytest.raises(ConfigError, match="index of a shard must not be negative, got -1"):
        make_shard(TINY, -1, split="train")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"seed": -1}, "seed must be at least 0, got -1"),
        ({"queries": 0}, "queries must be at least 1, got 0"),
        ({"count": (8, 51)}, r"count\[1\] must be between 1 and 50, got 51"),
        ({"distance_m": (1.2, 0.6)}, "distance_m must have the smaller value first, got 1.2 and 0.6"),
        ({"mixed_share": 1.5}, "mixed_share must be between 0 and 1, got 1.5"),
        ({"tilt_deg": float("nan")}, "tilt_deg must be a finite number, got nan"),
        ({"image_width_px": 32}, "image_width_px must be between 64 and 4096, got 32"),
        ({"randomizations": ()}, "randomizations must be of length at least 1, got"),
        ({"randomizations": ("strnog",)}, "no randomization preset named 'strnog'"),
        ({"crop_px": 8}, "crop_px must be between 16 and 1024, got 8"),
        ({"crop_padding": 0.9}, "crop_padding must be between 1 and 4, got 0.9"),
    ],
)
def test_settings_out_of_range_are_refused(changes: dict, text: str) -> None:
    with pytest.raises(LookupError if "strnog" in text else ConfigError, match=text):
        replace(DataConfig(), **changes)


def test_relief_puts_every_pixel_on_the_surface(tiny_shard):
    part = random_part(int(tiny_shard.part.removeprefix("random_")))
    for query in range(len(tiny_shard)):
        rows, columns = np.nonzero(tiny_shard.masks[query])
        T = tiny_shard.Ts_crop_part[query]
        depth_m = tiny_shard.relief_m[query, rows, columns].astype(float) + T[2, 3]
        pixels = np.stack([columns, rows], axis=-1) + 0.5
        points = transform_points(invert(T), tiny_shard.pinhole(query).back_project(pixels, depth_m))
        _, distances, _ = trimesh.proximity.closest_point(part.mesh, points)
        # Pixels at edges may take the depth of the source pixel beside them.
        assert np.median(distances) < 0.3e-3
        assert np.quantile(distances, 0.9) < 1.5e-3
