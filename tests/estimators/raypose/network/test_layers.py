"""Attention, DiT blocks, Fourier features and matching."""

import math

import pytest
import torch

from simpick.estimators.raypose.network.decoder import Decoder
from simpick.estimators.raypose.network.encoders.convolutional_encoder import ConvolutionalEncoder, orientation_channels
from simpick.estimators.raypose.network.encoders.view_encoder import fourier_features
from simpick.estimators.raypose.network.layers import Attention, DiTBlock, SelfAttentionBlock, TimestepEmbedder
from simpick.estimators.raypose.network.matching import FEATURES, Matcher
from simpick.estimators.raypose.network.pose_maps import ViewPoses
from tests.estimators.raypose.networks import TINY


def randn(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def test_attention_is_the_textbook_formula() -> None:
    torch.manual_seed(0)
    layer, x, context = Attention(8, 2), randn(1, 3, 8), randn(1, 5, 8, seed=1)
    q = layer.to_q(x)
    k, v = layer.to_kv(context)[..., :8], layer.to_kv(context)[..., 8:]
    heads = []
    for h in (slice(0, 4), slice(4, 8)):
        weights = (q[0, :, h] @ k[0, :, h].T / math.sqrt(4)).softmax(dim=-1)
        heads.append(weights @ v[0, :, h])
    torch.testing.assert_close(layer(x, layer.keys_values(context)), layer.out(torch.cat(heads, dim=-1))[None])


def test_keys_and_values_of_parts_are_those_of_the_whole() -> None:
    torch.manual_seed(0)
    layer, query, a, b = Attention(8, 2), randn(2, 3, 8), randn(2, 5, 8, seed=1), randn(2, 4, 8, seed=2)
    joined = tuple(torch.cat(pair, dim=2) for pair in zip(layer.keys_values(a), layer.keys_values(b), strict=True))
    whole = layer.keys_values(torch.cat([a, b], dim=1))
    torch.testing.assert_close(layer(query, joined), layer(query, whole))  # pyright: ignore


def test_self_attention_does_not_mind_the_order_of_tokens() -> None:
    torch.manual_seed(0)
    block, x = SelfAttentionBlock(8, 2), randn(2, 6, 8)
    order = [4, 2, 0, 5, 1, 3]
    torch.testing.assert_close(block(x[:, order]), block(x)[:, order])


def test_a_new_dit_block_is_the_identity() -> None:
    block, x = DiTBlock(8, 2), randn(2, 3, 4, 8)
    kv = block.cross_attention.keys_values(randn(2, 5, 8, seed=1))
    torch.testing.assert_close(block(x, kv, randn(2, 8, seed=2)), x, rtol=0, atol=0)


def test_every_gate_of_a_dit_block_opens() -> None:
    block, x = DiTBlock(8, 2), randn(2, 3, 4, 8)
    context, noise = randn(2, 5, 8, seed=1), randn(2, 8, seed=2)
    _, bias = block.adaLN_modulation.parameters()
    for gate in (2, 5, 8):
        with torch.no_grad():
            bias.zero_()
            bias[8 * gate : 8 * gate + 8] = 1.0
        changed = block(x, block.cross_attention.keys_values(context), noise) - x
        assert changed.abs().max() > 1e-3
        # Only the middle gate lets the context in.
        other = block(x, block.cross_attention.keys_values(context + 1), noise) - x
        assert torch.equal(other, changed) == (gate != 5)


def test_tokens_of_different_views_meet_only_through_the_context() -> None:
    block, x = DiTBlock(8, 2), randn(1, 3, 4, 8)
    weight, _ = block.adaLN_modulation.parameters()
    torch.nn.init.normal_(weight)
    kv, noise = block.cross_attention.keys_values(randn(1, 5, 8, seed=1)), randn(1, 8, seed=2)
    moved = x.clone()
    moved[:, 1] += 1
    before, after = block(x, kv, noise), block(moved, kv, noise)
    torch.testing.assert_close(after[:, [0, 2]], before[:, [0, 2]])
    assert (after[:, 1] - before[:, 1]).abs().max() > 0.1


def test_a_new_decoder_predicts_the_first_maps() -> None:
    decoder = Decoder(TINY)
    tokens = TINY.map_cells**2
    kv = decoder.keys_values(randn(2, 7, TINY.width))
    first = randn(2, 3, tokens, 6)
    out = decoder(randn(2, 3, tokens, 6), torch.tensor([0.0, -5.0]), randn(2, 3, tokens, TINY.width), first, kv)
    torch.testing.assert_close(out, first)


def test_noise_levels_are_distinguished() -> None:
    torch.manual_seed(0)
    levels = torch.linspace(2, -9, 100)
    embedded = TimestepEmbedder(16)(levels)
    nearest = torch.cdist(embedded, embedded).fill_diagonal_(1.0).amin()
    assert nearest > 1e-3


def test_fourier_features_have_the_frequencies_that_they_say() -> None:
    x = torch.tensor([[0.25, -0.5]])
    features = fourier_features(x, 2)
    angles = [math.pi * 0.25, 2 * math.pi * 0.25, -math.pi * 0.5, -2 * math.pi * 0.5]
    expected = [0.25, -0.5, *map(math.sin, angles), *map(math.cos, angles)]
    torch.testing.assert_close(features, torch.tensor([expected]))
    assert torch.equal(fourier_features(x, 0), x)


def test_orientation_channels_see_edges_and_not_brightness() -> None:
    masks = torch.zeros(1, 16, 16)
    masks[:, 3:13, 3:13] = 1
    rgb = torch.zeros(1, 3, 16, 16)
    rgb[..., 8:] = 0.8  # a vertical edge in the middle
    channels = orientation_channels(rgb, masks)
    torch.testing.assert_close(channels[0, 4], masks[0])
    middle = channels[0, :, 8, 8]
    # Gradient along x: its doubled angle is 0, so cosine is the magnitude and sine is 0.
    assert middle[3] > 0.5
    torch.testing.assert_close(middle[1:3], torch.stack([middle[3], torch.tensor(0.0)]), rtol=1e-3, atol=1e-5)
    elsewhere = torch.where(masks[:, None] > 0, rgb, torch.rand(rgb.shape, generator=torch.Generator().manual_seed(0)))
    # Surroundings change the last four channels only, and those within the mask only along its border.
    changed = orientation_channels(elsewhere, masks)
    torch.testing.assert_close(changed[:, :5], channels[:, :5])
    assert (changed[:, 5:] - channels[:, 5:]).abs().amax() > 0.5
    torch.testing.assert_close(changed[:, 5:, 4:12, 4:12], channels[:, 5:, 4:12, 4:12])
    # From light to dark instead of dark to light, by as much: the doubled angle stays.
    torch.testing.assert_close(orientation_channels(0.8 - rgb, masks)[0, 1:3, 4:12, 8], channels[0, 1:3, 4:12, 8])


def test_an_empty_mask_gives_finite_features() -> None:
    features = ConvolutionalEncoder(24)(torch.rand(2, 3, 48, 48), torch.zeros(2, 48, 48))
    assert features.fine is not None
    assert (features.coarse.shape, features.fine.shape) == ((2, 24, 6, 6), (2, 16, 12, 12))
    assert features.coarse.isfinite().all() and features.fine.isfinite().all()


def test_matches_are_the_softmax_of_cosines_over_covered_cells() -> None:
    matcher = Matcher(4, 2)
    with torch.no_grad():
        matcher.log_temperature.fill_(math.log(2.0))
    query = torch.tensor([[[1.0, 0.0]]])
    templates = torch.tensor([[[1.0, 0.0], [0.0, 1.0], [1.0, 0.0]]])
    points = torch.tensor([[[0.2, 0.0, 0.0], [0.0, 0.4, 0.0], [9.0, 9.0, 9.0]]])
    matches = matcher.match(query, templates, points, torch.tensor([[1.0, 0.5, 0.1]]), torch.ones(1, 1))
    p = math.exp(2) / (math.exp(2) + 1)
    torch.testing.assert_close(matches.log_probabilities.exp(), torch.tensor([[[p, 1 - p, 0.0]]]))
    torch.testing.assert_close(matches.points, torch.tensor([[[0.2 * p, 0.4 * (1 - p), 0.0]]]))
    variance = p * 0.2**2 + (1 - p) * 0.4**2 - (0.2 * p) ** 2 - (0.4 * (1 - p)) ** 2
    assert matches.spread.item() == pytest.approx(math.sqrt(variance + 1e-6), rel=1e-4)
    assert matches.similarity.item() == pytest.approx(1.0)


def test_match_features_lie_in_each_view() -> None:
    matcher = Matcher(4, 2)
    points = torch.tensor([[[0.1, 0.0, 0.0]]])
    one = torch.tensor([[[1.0, 0.0]]])
    matches = matcher.match(one, one, points, torch.ones(1, 1), torch.ones(1, 1))
    turn = torch.tensor([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    R = torch.stack([torch.eye(3), turn])[None]
    reference = ViewPoses(R, torch.zeros(1, 2, 2), torch.ones(1, 2))
    residuals = torch.tensor([[[[0.1, 0.2]], [[0.3, 0.4]]]])
    centroids = torch.tensor([[[-0.5, 0.5]]])
    features = matches.features(residuals, reference, torch.tensor([[1.0, 2.0]]), torch.tensor([[0.7]]), centroids)
    assert features.shape == (1, 2, 1, FEATURES)
    torch.testing.assert_close(features[0, :, 0, :3], torch.tensor([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]]))
    torch.testing.assert_close(features[0, :, 0, 3:5], 4 * residuals[0, :, 0])
    torch.testing.assert_close(features[0, :, 0, [6, 8]], torch.tensor([[1.0, 0.7], [1.0, 0.7]]))
    torch.testing.assert_close(features[0, :, 0, 9:], centroids[0].expand(2, 2))


def test_no_covered_cell_still_gives_finite_matches() -> None:
    matches = Matcher(4, 2).match(randn(2, 3, 2), randn(2, 4, 2), randn(2, 4, 3), torch.zeros(2, 4), torch.ones(2, 3))
    for value in (matches.log_probabilities, matches.points, matches.spread, matches.similarity):
        assert value.isfinite().all()
