"""DINOv2 as image encoder, with a tiny random transformer of the same make."""

import dataclasses
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from simpick.errors import CheckpointError, ConfigError
from simpick.estimators.raypose.checkpoints import load_checkpoint, save_checkpoint
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.encoders import dino_encoder
from simpick.estimators.raypose.network.encoders.convolutional_encoder import ConvolutionalEncoder
from simpick.estimators.raypose.network.encoders.dino_encoder import (
    DinoEncoder,
    load_dino_weights,
    make_dino_encoder,
    make_vit,
)
from simpick.estimators.raypose.network.model import RayPose

needs_timm = pytest.mark.skipif(find_spec("timm") is None, reason="timm (the extra dinov2) is not installed")

CONFIG = RayPoseConfig(
    flow=False,
    image_encoder="dinov2_vits14",
    crop_px=56,
    local_cells=4,
    map_cells=2,
    local_width=24,
    match_width=8,
    width=16,
    heads=2,
    decoder_blocks=1,
)


def tiny_vit(seed: int, image_px: int = 56):
    torch.manual_seed(seed)
    return make_vit("dinov2_vits14", image_px, depth=2, embed_dim=24, num_heads=2)


@pytest.fixture
def images() -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(1)
    masks = torch.zeros(3, 56, 56)
    masks[:, 10:40, 14:50] = 1.0
    return torch.rand((3, 3, 56, 56), generator=generator), masks


@needs_timm
def test_features_are_the_patches_row_by_row(images) -> None:
    rgb, masks = images
    encoder = DinoEncoder(tiny_vit(0))
    features = encoder(rgb, masks).coarse
    assert features.shape == (3, 24, 4, 4)
    mean, std = torch.tensor([0.485, 0.456, 0.406]), torch.tensor([0.229, 0.224, 0.225])
    normalised = ((rgb * masks[:, None]).movedim(1, -1) - mean) / std
    tokens = encoder.vit.forward_features(normalised.movedim(-1, 1))
    torch.testing.assert_close(features[1, :, 2, 3], tokens[1, 1 + 2 * 4 + 3])


@needs_timm
def test_what_is_beside_the_part_does_not_matter(images) -> None:
    rgb, masks = images
    encoder = DinoEncoder(tiny_vit(0))
    elsewhere = torch.where(masks[:, None] > 0, rgb, 1 - rgb)
    torch.testing.assert_close(encoder(elsewhere, masks).coarse, encoder(rgb, masks).coarse)


@needs_timm
def test_it_is_frozen_and_stays_in_evaluation_mode(images) -> None:
    encoder = DinoEncoder(tiny_vit(0)).train()
    assert not encoder.vit.training
    assert not any(p.requires_grad for p in encoder.parameters())
    assert not encoder(*images).coarse.requires_grad


@needs_timm
@pytest.mark.parametrize("suffix", [".safetensors", ".pth"])
def test_weights_come_from_a_local_file(tmp_path: Path, images, suffix: str) -> None:
    source, target = DinoEncoder(tiny_vit(1)), DinoEncoder(tiny_vit(2))
    path = tmp_path / f"vit{suffix}"
    # Meta's files hold the mask token of pre-training too.
    tensors = source.vit.state_dict() | {"mask_token": torch.zeros(1, 24)}
    save_file(tensors, path) if suffix == ".safetensors" else torch.save(tensors, path)
    assert not torch.allclose(source(*images).coarse, target(*images).coarse)
    load_dino_weights(target, path)
    torch.testing.assert_close(source(*images).coarse, target(*images).coarse, rtol=0, atol=0)


@needs_timm
def test_positions_of_another_image_size_are_resampled(tmp_path: Path) -> None:
    source = tiny_vit(1, image_px=8 * 14)
    # The published backbones were trained at 518 px, 37 cells a side.
    x = torch.linspace(-1, 1, 8)[None, None, :, None].expand(1, 8, 8, 24)
    with torch.no_grad():
        source.pos_embed[:, 1:] = x.reshape(1, 64, 24)
    save_file(source.state_dict(), tmp_path / "vit.safetensors")
    encoder = DinoEncoder(tiny_vit(2))
    load_dino_weights(encoder, tmp_path / "vit.safetensors")
    positions = encoder.vit.pos_embed
    torch.testing.assert_close(positions[:, 0], source.pos_embed[:, 0])
    grid = positions[0, 1:].view(4, 4, 24)
    # A ramp along x remains one: row-by-row order is kept.
    torch.testing.assert_close(grid[0], grid[3], atol=1e-5, rtol=0)
    torch.testing.assert_close(grid[0, 1:, 0].diff(), grid[0, :-1, 0].diff().flip(0), atol=1e-4, rtol=0)
    assert grid[0, 3, 0] - grid[0, 0, 0] > 1.2


@needs_timm
def test_files_that_do_not_fit_say_why(tmp_path: Path) -> None:
    encoder = DinoEncoder(tiny_vit(2))

    def error_of(name: str) -> str:
        with pytest.raises(CheckpointError) as caught:
            load_dino_weights(encoder, tmp_path / name)
        return str(caught.value)

    assert error_of("none.pth") == (
        f"there are no DINOv2 weights at {tmp_path / 'none.pth'}; give a local .safetensors or .pth file"
    )
    good = encoder.vit.state_dict()
    save_file(good, tmp_path / "good.safetensors")
    data = (tmp_path / "good.safetensors").read_bytes()
    (tmp_path / "short.safetensors").write_bytes(data[: len(data) // 2])
    assert "short.safetensors is damaged or no file of weights (" in error_of("short.safetensors")
    torch.save(good, tmp_path / "good.pth")
    data = (tmp_path / "good.pth").read_bytes()
    (tmp_path / "short.pth").write_bytes(data[: len(data) // 2])
    assert "short.pth is damaged or no file of weights (" in error_of("short.pth")
    (tmp_path / "text.pth").write_text("not weights")
    assert "text.pth is damaged or no file of weights (" in error_of("text.pth")
    (tmp_path / "empty.pth").write_bytes(b"")
    assert "empty.pth is damaged or no file of weights (" in error_of("empty.pth")
    torch.save([1, 2], tmp_path / "list.pth")
    assert error_of("list.pth").endswith("must hold tensors by name, as DINOv2's published backbones do")
    others = {k: v for k, v in good.items() if k != "norm.bias"} | {"head.bias": torch.ones(3)}
    save_file(others, tmp_path / "a.safetensors")
    assert error_of("a.safetensors").endswith("do not fit this DINOv2: norm.bias is missing; head.bias is unknown")
    save_file(good | {"cls_token": torch.zeros(1, 1, 32)}, tmp_path / "b.safetensors")
    assert error_of("b.safetensors").endswith("cls_token must have shape (1, 1, 24), got (1, 1, 32)")
    save_file(good | {"pos_embed": torch.zeros(1, 7, 24)}, tmp_path / "c.safetensors")
    assert error_of("c.safetensors").endswith("pos_embed must have shape (1, 17, 24), got (1, 7, 24)")
    save_file(good | {"norm.bias": torch.full((24,), float("nan"))}, tmp_path / "d.safetensors")
    assert error_of("d.safetensors").endswith("d.safetensors must be finite numbers; get the file again")


@needs_timm
def test_a_network_of_another_width_is_refused() -> None:
    with (
        torch.device("meta"),
        pytest.raises(ConfigError, match="local_width must be 384, the width of dinov2_vits14, got 24"),
    ):
        make_dino_encoder(CONFIG)


@needs_timm
def test_an_encoder_has_the_published_names_and_shapes() -> None:
    with torch.device("meta"):
        vit = make_dino_encoder(dataclasses.replace(CONFIG, local_width=384)).vit
    shapes = {name: tuple(tensor.shape) for name, tensor in vit.state_dict().items()}
    assert len(shapes) == 4 + 12 * 14 + 2
    assert shapes["pos_embed"] == (1, 17, 384)
    assert shapes["patch_embed.proj.weight"] == (384, 3, 14, 14)
    assert shapes["blocks.11.ls2.gamma"] == (384,)


@needs_timm
def test_checkpoints_leave_dino_out_and_ask_for_it(tmp_path: Path, images, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dino_encoder, "make_dino_encoder", lambda config: DinoEncoder(tiny_vit(3)))
    model = RayPose(CONFIG).eval()
    assert isinstance(model.image_encoder, DinoEncoder)
    save_file(model.image_encoder.vit.state_dict(), tmp_path / "vit.safetensors")
    save_checkpoint(tmp_path / "model.safetensors", model, {})
    with pytest.raises(CheckpointError, match="needs the weights of dinov2_vits14, which are not part of it: pass a"):
        load_checkpoint(tmp_path / "model.safetensors")
    monkeypatch.setattr(dino_encoder, "make_dino_encoder", lambda config: DinoEncoder(tiny_vit(4)))
    loaded = load_checkpoint(tmp_path / "model.safetensors", dino_weights=tmp_path / "vit.safetensors").model
    torch.testing.assert_close(
        loaded.image_encoder(*images).coarse, model.image_encoder(*images).coarse, rtol=0, atol=0
    )


def test_an_encoder_that_is_trained_takes_no_dino(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="this network's image encoder is not DINOv2"):
        load_dino_weights(ConvolutionalEncoder(24), tmp_path / "vit.pth")


def test_without_timm_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "timm", None)
    with pytest.raises(
        ConfigError, match=r"'dinov2_vits14' needs timm .*; install it with: pip install 'simpick\[dino"
    ):
        make_vit("dinov2_vits14", 56)
