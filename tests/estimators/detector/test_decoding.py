"""Perfect maps decode into exactly the instances that they were made of, of any shape."""

import numpy as np
import pytest

from simpick.estimators.detector.affinities import OFFSETS
from simpick.estimators.detector.agglomeration import RegionPairs, agglomerate, pair_regions
from simpick.estimators.detector.decoding import DecodingConfig, full_mask, label_nodes
from simpick.estimators.detector.merge_tree import MAX_SUPERPIXELS, MergeTree, merge_tree
from simpick.estimators.detector.superpixels import superpixels
from tests.estimators.detector.ideal_maps import ideal_maps


def disc(row: int, column: int, radius: float, size: int = 96) -> np.ndarray:
    y, x = np.mgrid[:size, :size]
    return (y - row) ** 2 + (x - column) ** 2 < radius**2


CONFIG = DecodingConfig()


def tree_of(ids: np.ndarray) -> tuple[MergeTree, np.ndarray]:
    foreground, affinities = ideal_maps(ids)
    return merge_tree(foreground > 0.5, affinities, certain=CONFIG.certain, possible=CONFIG.possible), foreground


def decoded(ids: np.ndarray) -> np.ndarray:
    tree, foreground = tree_of(ids)
    return label_nodes(tree, tree.cut(lambda k: True), foreground, CONFIG.min_cells).labels


def same_partition(a: np.ndarray, b: np.ndarray) -> bool:
    pairs = {(int(i), int(j)) for i, j in zip(a.ravel(), b.ravel(), strict=True)}
    return len(pairs) == len({i for i, _ in pairs}) == len({j for _, j in pairs})


BAR = np.zeros((96, 96), bool)
BAR[40:48, 5:90] = True
SCENES = {
    "touching discs": [disc(30, 30, 16), disc(30, 61, 16)],
    "a ring around a disc": [disc(48, 48, 30) & ~disc(48, 48, 16), disc(48, 48, 16)],
    "a bar cut in two by a disc": [BAR & ~disc(44, 48, 12), disc(44, 48, 12)],
    "a hook": [disc(48, 48, 30) & ~disc(48, 48, 20) & (np.mgrid[:96, :96][1] < 60)],
    "a long thin bar": [BAR],
}


@pytest.mark.parametrize("name", SCENES)
def test_perfect_maps_give_back_the_instances(name: str) -> None:
    ids = np.zeros((96, 96), int)
    for k, mask in enumerate(SCENES[name], 1):
        ids[mask] = k
    assert same_partition(decoded(ids), ids)


def test_background_alone_has_no_instances() -> None:
    assert decoded(np.zeros((32, 48), int)).max() == 0


def test_specks_are_dropped() -> None:
    ids = np.zeros((64, 64), int)
    ids[10:12, 10:12] = 1
    ids[30:50, 30:50] = 2
    assert decoded(ids).max() == 1


def test_superpixels_cover_the_foreground_and_cross_no_border() -> None:
    ids = np.zeros((96, 96), int)
    ids[disc(30, 30, 16)], ids[disc(30, 61, 16)] = 1, 2
    foreground, affinities = ideal_maps(ids)
    regions = superpixels(foreground > 0.5, affinities)
    assert ((regions > 0) == (ids > 0)).all()
    assert all(len(np.unique(ids[regions == r])) == 1 for r in range(1, regions.max() + 1))


def test_agglomeration_merges_by_the_mean_not_by_the_best_pair() -> None:
    # Three regions: 1 and 2 alike everywhere, 2 and 3 alike in one pair of ten.
    pairs = RegionPairs(np.array([[1, 2], [2, 3]]), np.array([9.0, 1.0]), np.array([10.0, 10.0]))
    merges = agglomerate(3, pairs, 0.5)
    assert [{m.kept, m.absorbed} for m in merges] == [{1, 2}]
    assert merges[0].affinity == pytest.approx(0.9)


def test_agglomeration_goes_from_the_most_alike_to_the_least() -> None:
    pairs = RegionPairs(np.array([[1, 2], [2, 3], [1, 3]]), np.array([6.0, 9.0, 2.0]), np.full(3, 10.0))
    first, second = agglomerate(3, pairs, 0.3)
    assert {first.kept, first.absorbed} == {2, 3}
    assert second.affinity == pytest.approx((6 + 2) / 20)


def test_pair_sums_count_each_pair_of_cells_once() -> None:
    regions = np.array([[1, 1, 2, 2]], np.int32).repeat(2, axis=0)
    pairs = pair_regions(regions, ideal_maps(regions)[1])
    found = zip(pairs.regions.tolist(), pairs.sums, pairs.counts, strict=True)
    # To the right: one pair per row inside each region and one across; downwards: two per region.
    assert {tuple(p): (s, c) for p, s, c in found} == {(1, 1): (4, 4), (1, 2): (0, 2), (2, 2): (4, 4)}


def test_uncertain_merges_are_nodes_that_can_be_accepted_or_divided() -> None:
    ids = np.zeros((64, 96), int)
    ids[10:40, 10:30], ids[10:40, 30:50] = 1, 2
    foreground, affinities = ideal_maps(ids)
    # Between the two halves the network is undecided.
    both = ideal_maps((ids > 0).astype(int))[1]
    affinities = np.where((both > 0) & (affinities == 0), 0.45, affinities).astype(np.float32)
    tree = merge_tree(foreground > 0.5, affinities, certain=0.6, possible=0.2)
    whole, halves = tree.cut(lambda k: True), tree.cut(lambda k: False)
    assert len(whole) == 1 and len(halves) == 2
    assert tree.nodes[whole[0]].affinity == pytest.approx(0.45, abs=0.01)
    assert same_partition(label_nodes(tree, halves, foreground, 8).labels, ids)


def test_features_say_how_sure_the_network_was() -> None:
    ids = np.zeros((64, 64), int)
    ids[10:40, 10:30], ids[10:40, 30:50] = 1, 2
    tree, foreground = tree_of(ids)
    features = label_nodes(tree, tree.cut(lambda k: True), foreground, 8).features
    np.testing.assert_allclose(features, [[1, 0, 1, np.log(600)]] * 2)


def test_full_masks_have_the_image_size_and_do_not_overlap() -> None:
    labels = np.zeros((24, 32), np.int32)
    labels[4:12, 4:20], labels[12:20, 4:20] = 1, 2
    masks = [full_mask(labels == k, 47, 63) for k in (1, 2)]
    assert [mask.shape for mask in masks] == [(47, 63)] * 2
    assert not (masks[0] & masks[1]).any()
    assert masks[0].sum() == pytest.approx(8 * 16 * 4, rel=0.05)


@pytest.mark.parametrize("scale", [(2 / 3, 2 / 3), (0.5, 0.75), (1.0, 1.0), (0.3, 0.3)])
def test_full_masks_lie_where_their_cells_do_at_any_scale(scale: tuple[float, float]) -> None:
    """A disc of cells, compared with the same disc drawn in the image's own pixels."""
    rows, columns = (np.arange(n) + 0.5 for n in (96, 128))
    cells = np.hypot(rows[:, None] - 40, columns[None] - 90) < 20
    height, width = round(2 * 96 * scale[0]), round(2 * 128 * scale[1])
    mask = full_mask(cells, height, width, scale=scale)
    y, x = ((np.arange(n) + 0.5) / (2 * s) for n, s in zip((height, width), scale, strict=True))
    disc = np.hypot(y[:, None] - 40, x[None] - 90) < 20
    assert mask.shape == disc.shape
    assert (mask & disc).sum() / (mask | disc).sum() > 0.95
    assert not (mask & full_mask(~cells, height, width, scale=scale)).any()


def test_noise_has_no_more_superpixels_than_the_limit() -> None:
    """Merging takes time with the square of their number."""
    rng = np.random.default_rng(0)
    affinities = rng.random((len(OFFSETS), 160, 200)).astype(np.float32)
    tree = merge_tree(np.ones((160, 200), bool), affinities, certain=0.7, possible=0.6)
    assert tree.regions.max() == MAX_SUPERPIXELS
    assert np.unique(tree.regions).tolist() == list(range(MAX_SUPERPIXELS + 1))


def test_a_dropped_speck_beside_an_instance_is_no_other_instance() -> None:
    ids = np.zeros((64, 64), int)
    ids[10:40, 10:30], ids[20:22, 30:33] = 1, 2
    foreground, affinities = ideal_maps(ids)
    both = ideal_maps((ids > 0).astype(int))[1]
    affinities = np.where((both > 0) & (affinities == 0), 0.3, affinities).astype(np.float32)
    tree = merge_tree(foreground > 0.5, affinities, certain=CONFIG.certain, possible=CONFIG.possible)
    separate = tree.cut(lambda k: False)
    assert len(separate) == 2
    (features,) = label_nodes(tree, separate, foreground, CONFIG.min_cells).features
    assert features[1] == 0
