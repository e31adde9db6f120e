"""The decoder: DiT blocks that denoise every template's pose maps, looking at the query and all fused templates."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.layers import DiTBlock, KeysValues, TimestepEmbedder
from simpick.estimators.raypose.network.pose_maps import CHANNELS, canonical_rays, encode_offsets


class Decoder(nn.Module):
    """Predicts clean maps from noisy ones (x0 prediction), as a change of first maps that are known."""

    neutral: Tensor

    def __init__(self, config: RayPoseConfig) -> None:
        super().__init__()
        self.embed_maps = nn.Linear(2 * CHANNELS, config.width)
        self.embed_noise = TimestepEmbedder(config.width)
        self.blocks = nn.ModuleList(DiTBlock(config.width, config.heads) for _ in range(config.decoder_blocks))
        self.norm_out = nn.LayerNorm(config.width, elementwise_affine=False)
        self.modulation_out = nn.Linear(config.width, 2 * config.width)
        self.out = nn.Linear(config.width, CHANNELS)
        for layer in (self.modulation_out, self.out):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.bias)
        cells = config.map_cells
        rays = canonical_rays(cells)
        offsets = encode_offsets(torch.zeros(2), cells, config.padding)
        neutral = torch.cat([rays, offsets, torch.zeros(cells, cells, 1)], dim=-1)
        self.register_buffer("neutral", neutral.flatten(0, 1), persistent=False)  # (tokens, 6)

    def keys_values(self, context: Float[Tensor, "batch tokens width"]) -> list[KeysValues]:
        """Return each block's keys and values of what is attended to; they do not depend on the noise."""
        return [block.cross_attention.keys_values(context) for block in self.blocks]  # pyright: ignore

    def forward(
        self,
        maps: Float[Tensor, "batch views tokens 6"],
        log_snr: Float[Tensor, "batch"],
        base: Float[Tensor, "batch views tokens width"],
        first: Float[Tensor, "batch views tokens 6"],
        kv: Sequence[KeysValues],
    ) -> Float[Tensor, "batch views tokens 6"]:
        """Return the clean maps, as a change of `first`; `base` is all that is known beside the noisy maps."""
        noise = self.embed_noise(log_snr)  # (batch, width)
        x = self.embed_maps(torch.cat([maps, first], dim=-1)) + base  # (batch, views, tokens, width)
        for block, block_kv in zip(self.blocks, kv, strict=True):
            x = block(x, block_kv, noise)
        shift, scale = self.modulation_out(torch.nn.functional.silu(noise))[:, None, None].chunk(2, dim=-1)
        return first + self.out(self.norm_out(x) * (1 + scale) + shift)
