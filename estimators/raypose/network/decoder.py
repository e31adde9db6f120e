"""The decoder: DiT blocks that denoise every template's pose maps, conditioned on query and fused templates."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor, nn

from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.layers import DiTBlock, KeysValues, TimestepEmbedder, adaln_modulation, modulate
from simpick.estimators.raypose.network.pose_maps import CHANNELS, canonical_rays, encode_offsets


class Decoder(nn.Module):
    """Predicts clean maps from noisy ones (paper, sec. 3.3.2 and eq. 10).

    Departure from the paper: the prediction is a change of initial maps, those of the poses from matches and flow.
    """

    neutral: Tensor

    def __init__(self, config: RayPoseConfig) -> None:
        super().__init__()
        width, cells = config.width, config.map_cells
        self.embed_maps = nn.Linear(2 * CHANNELS, width)
        self.embed_noise = TimestepEmbedder(width)
        self.blocks = nn.ModuleList(DiTBlock(width, config.heads) for _ in range(config.decoder_blocks))
        self.norm_out = nn.LayerNorm(width, elementwise_affine=False)
        self.adaLN_modulation = adaln_modulation(width, 2)
        self.out = nn.Linear(width, CHANNELS)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)
        offsets = encode_offsets(torch.zeros(2), cells, config.padding)
        neutral = torch.cat([canonical_rays(cells), offsets, torch.zeros(cells, cells, 1)], dim=-1)
        self.register_buffer("neutral", neutral.flatten(0, 1), persistent=False)  # (tokens, 6): "as in the reference"

    def keys_values(self, context: Float[Tensor, "*batch tokens width"]) -> tuple[KeysValues, ...]:
        """Return each block's keys and values of what is attended to; they do not depend on the noise."""
        return tuple(block.cross_attention.keys_values(context) for block in self.blocks)  # pyright: ignore

    def forward(
        self,
        maps: Float[Tensor, "batch views tokens 6"],
        log_snr: Float[Tensor, "batch"],
        tokens: Float[Tensor, "batch views tokens width"],
        initial: Float[Tensor, "batch views tokens 6"],
        context: Sequence[KeysValues],
    ) -> Float[Tensor, "batch views tokens 6"]:
        """Return the clean maps; `tokens` is what is known of each cell, `context` what the blocks attend to."""
        timestep = self.embed_noise(log_snr)  # (batch, width)
        x = self.embed_maps(torch.cat([maps, initial], dim=-1)) + tokens  # (batch, views, tokens, width)
        for block, keys_values in zip(self.blocks, context, strict=True):
            x = block(x, keys_values, timestep)
        shift, scale = self.adaLN_modulation(timestep)[:, None, None].chunk(2, dim=-1)
        return initial + self.out(modulate(self.norm_out(x), shift, scale))
