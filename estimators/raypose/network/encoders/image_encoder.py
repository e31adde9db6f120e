"""The image encoder E_I that a configuration names."""

from __future__ import annotations

from torch import nn

from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.encoders.convolutional_encoder import ConvolutionalEncoder


def make_image_encoder(config: RayPoseConfig) -> nn.Module:
    """Return a module from RGB and masks to `FeatureMaps`; DINOv2's weights are random until they are loaded."""
    if config.is_dino:
        # Needs timm, which is optional.
        from simpick.estimators.raypose.network.encoders.dino_encoder import make_dino_encoder

        return make_dino_encoder(config)
    return ConvolutionalEncoder(config.local_width)
