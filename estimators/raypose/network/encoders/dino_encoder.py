"""DINOv2 as image encoder (Oquab et al. 2023), frozen as in the paper; built by timm, weights from a local file."""

from __future__ import annotations

import importlib
import math
import pickle
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import safetensors
import torch
from jaxtyping import Float
from safetensors.torch import load_file
from torch import Tensor, nn

from simpick.errors import CheckpointError, ConfigError
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.encoders.feature_maps import FeatureMaps
from simpick.estimators.weight_files import check_weights

PATCH_PX = 14
_TIMM_NAMES = {
    "dinov2_vits14": "vit_small_patch14_dinov2",
    "dinov2_vitb14": "vit_base_patch14_dinov2",
    "dinov2_vitl14": "vit_large_patch14_dinov2",
}
_IMAGENET_MEAN = (0.485, 0.456, 0.406)
_IMAGENET_STD = (0.229, 0.224, 0.225)


class DinoEncoder(nn.Module):
    """A frozen vision transformer on masked crops; it stays in evaluation mode and learns nothing."""

    vit: Any
    mean: Tensor
    std: Tensor

    def __init__(self, vit: nn.Module) -> None:
        super().__init__()
        self.vit = vit.requires_grad_(False).eval()
        self.register_buffer("mean", torch.tensor(_IMAGENET_MEAN).view(3, 1, 1), persistent=False)
        self.register_buffer("std", torch.tensor(_IMAGENET_STD).view(3, 1, 1), persistent=False)

    def train(self, mode: bool = True) -> DinoEncoder:
        """Set the mode, but not the transformer's."""
        super().train(mode)
        self.vit.eval()
        return self

    @torch.no_grad()
    def forward(self, rgb: Float[Tensor, "batch 3 size size"], masks: Float[Tensor, "batch size size"]) -> FeatureMaps:
        """Return one feature vector per patch of 14 x 14 pixels; RGB in [0, 1], black outside the mask."""
        x = (rgb * masks[:, None] - self.mean) / self.std
        tokens = self.vit.forward_features(x)  # (batch, 1 + cells * cells, width)
        cells = rgb.shape[-1] // PATCH_PX
        return FeatureMaps(tokens[:, -cells * cells :].mT.unflatten(-1, (cells, cells)), None)


def make_dino_encoder(config: RayPoseConfig) -> DinoEncoder:
    """Return the encoder that a configuration names, its weights random until `load_dino_weights`.

    Raises:
        ConfigError: timm is not installed, or `local_width` is not the transformer's.
    """
    vit = make_vit(config.image_encoder, config.crop_px)
    if vit.embed_dim != config.local_width:
        raise ConfigError(
            f"local_width must be {vit.embed_dim}, the width of {config.image_encoder}, got {config.local_width}"
        )
    return DinoEncoder(vit)


def make_vit(name: str, image_px: int, **overrides: Any) -> Any:
    """Return one of DINOv2's transformers with random weights; nothing is downloaded.

    `overrides` go to timm's `VisionTransformer`: ``depth``, ``embed_dim`` and ``num_heads`` make it small.

    Raises:
        ConfigError: timm is not installed.
    """
    with _torchvision_not_needed():
        try:
            timm = importlib.import_module("timm")
        except ImportError as error:
            raise ConfigError(
                f"the image encoder {name!r} needs timm ({error}); install it with: pip install 'simpick[dinov2]'"
            ) from error
    return timm.create_model(_TIMM_NAMES[name], pretrained=False, img_size=image_px, num_classes=0, **overrides)


def load_dino_weights(encoder: nn.Module, path: Path) -> None:
    """Fill the transformer from a local file: Meta's ``.pth`` or timm's ``.safetensors``, position grid resampled.

    Raises:
        CheckpointError: the file is missing, damaged or foreign, or holds another transformer's weights.
    """
    if not isinstance(encoder, DinoEncoder):
        raise CheckpointError(f"{path} cannot be used: this network's image encoder is not DINOv2")
    vit = encoder.vit
    tensors = _read(path)
    # Only pre-training needs it; timm's own files leave it out.
    tensors.pop("mask_token", None)
    if "pos_embed" in tensors:
        tensors["pos_embed"] = _fit_positions(tensors["pos_embed"], vit)
    check_weights(path, tensors, vit.state_dict(), "this DINOv2")
    vit.load_state_dict(tensors)


def _fit_positions(positions: Tensor, vit: Any) -> Tensor:
    """Return position embeddings for the transformer's grid, or the same where they are no square grid's."""
    side = math.isqrt(max(0, positions.shape[1] - 1)) if positions.ndim == 3 else 0
    if side == 0 or side * side + 1 != positions.shape[1] or (side, side) == vit.patch_embed.grid_size:
        return positions
    layers = importlib.import_module("timm.layers")
    return layers.resample_abs_pos_embed(positions.float(), list(vit.patch_embed.grid_size), num_prefix_tokens=1)


def _read(path: Path) -> dict[str, Tensor]:
    if not path.is_file():
        raise CheckpointError(f"there are no DINOv2 weights at {path}; give a local .safetensors or .pth file")
    try:
        if path.suffix == ".safetensors":
            return load_file(path)
        values = torch.load(path, map_location="cpu", weights_only=True)
    except (safetensors.SafetensorError, pickle.UnpicklingError, OSError, EOFError, ValueError, RuntimeError) as error:
        cause = str(error).strip().splitlines()
        raise CheckpointError(
            f"{path} is damaged or no file of weights ({cause[0] if cause else type(error).__name__}); get it again"
        ) from error
    if not isinstance(values, dict) or not values or not all(isinstance(v, Tensor) for v in values.values()):
        raise CheckpointError(f"{path} must hold tensors by name, as DINOv2's published backbones do")
    return values


class _Absent(type):
    """Metaclass of stand-ins for names that are only looked up on import: each attribute is another stand-in."""

    def __getattr__(cls, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        value = _Absent(name, (), {})
        setattr(cls, name, value)
        return value


class _AbsentModule(ModuleType):
    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.__path__ = []  # A package: its submodules may be imported.

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _Absent(name, (), {})


@contextmanager
def _torchvision_not_needed() -> Iterator[None]:
    """Make timm importable where torchvision is not: its operators do not load into every build of torch.

    timm's transformers use nothing of torchvision, but its data sets and image transforms import it.
    """
    if "timm" in sys.modules or _torchvision_works():
        yield
        return
    names = ["", ".transforms", ".transforms.functional", ".datasets", ".ops", ".ops.misc"]
    stand_ins = {f"torchvision{name}": _AbsentModule(f"torchvision{name}") for name in names}
    sys.modules.update(stand_ins)
    try:
        yield
    finally:
        for name in stand_ins:
            sys.modules.pop(name, None)


def _torchvision_works() -> bool:
    try:
        importlib.import_module("torchvision")
    except (ImportError, RuntimeError, OSError):
        # Remove the modules that were imported before it failed.
        for name in [n for n in sys.modules if n.split(".")[0] == "torchvision"]:
            del sys.modules[name]
        return False
    return True
