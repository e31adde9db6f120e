"""Layers of fuser and decoder: attention, MLP, and the DiT block with adaLN-zero (Peebles and Xie 2023)."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

KeysValues = tuple[Tensor, Tensor]
"""Keys and values, each (batch, heads, tokens, width / heads)."""


class Attention(nn.Module):
    """Multi-head attention whose keys and values can be computed once and used many times."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.to_q = nn.Linear(width, width)
        self.to_kv = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def keys_values(self, tokens: Float[Tensor, "batch tokens width"]) -> KeysValues:
        """Return what `forward` needs of the tokens that are attended to."""
        k, v = self.to_kv(tokens).chunk(2, dim=-1)
        return self._split(k), self._split(v)

    def forward(self, x: Float[Tensor, "batch tokens width"], kv: KeysValues) -> Float[Tensor, "batch tokens width"]:
        """Return what each token gathers."""
        attended = F.scaled_dot_product_attention(self._split(self.to_q(x)), *kv)
        return self.out(attended.transpose(1, 2).flatten(2))

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(-1, (self.heads, -1)).transpose(1, 2)  # (batch, heads, tokens, width / heads)


def mlp(width: int, ratio: int = 4) -> nn.Sequential:
    """Return the two-layer perceptron of a transformer block."""
    return nn.Sequential(nn.Linear(width, ratio * width), nn.GELU(), nn.Linear(ratio * width, width))


class SelfAttentionBlock(nn.Module):
    """A pre-norm transformer block."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm_attention = nn.LayerNorm(width)
        self.attention = Attention(width, heads)
        self.norm_mlp = nn.LayerNorm(width)
        self.mlp = mlp(width)

    def forward(self, x: Float[Tensor, "batch tokens width"]) -> Float[Tensor, "batch tokens width"]:
        """Return the tokens after they have seen one another."""
        normed = self.norm_attention(x)
        x = x + self.attention(normed, self.attention.keys_values(normed))
        return x + self.mlp(self.norm_mlp(x))


class DiTBlock(nn.Module):
    """Self-attention, cross-attention and MLP, each scaled, shifted and gated by the noise level (adaLN-zero)."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm_self = nn.LayerNorm(width, elementwise_affine=False)
        self.self_attention = Attention(width, heads)
        self.norm_cross = nn.LayerNorm(width, elementwise_affine=False)
        self.cross_attention = Attention(width, heads)
        self.norm_mlp = nn.LayerNorm(width, elementwise_affine=False)
        self.mlp = mlp(width)
        self.modulation = nn.Linear(width, 9 * width)
        nn.init.zeros_(self.modulation.weight)
        nn.init.zeros_(self.modulation.bias)

    def forward(
        self,
        x: Float[Tensor, "batch views tokens width"],
        kv: KeysValues,
        noise_level: Float[Tensor, "batch width"],
    ) -> Float[Tensor, "batch views tokens width"]:
        """Return the tokens after one block: those of one view see one another, and all see what `kv` is made of."""
        shift_s, scale_s, gate_s, shift_c, scale_c, gate_c, shift_m, scale_m, gate_m = self.modulation(
            F.silu(noise_level)
        )[:, None, None].chunk(9, dim=-1)  # each (batch, 1, 1, width)
        batch, views = x.shape[:2]
        h = (self.norm_self(x) * (1 + scale_s) + shift_s).flatten(0, 1)  # (batch * views, tokens, width)
        h = self.self_attention(h, self.self_attention.keys_values(h))
        x = x + gate_s * h.unflatten(0, (batch, views))
        h = (self.norm_cross(x) * (1 + scale_c) + shift_c).flatten(1, 2)  # (batch, views * tokens, width)
        x = x + gate_c * self.cross_attention(h, kv).unflatten(1, (views, -1))
        h = self.norm_mlp(x) * (1 + scale_m) + shift_m
        return x + gate_m * self.mlp(h)


class TimestepEmbedder(nn.Module):
    """Sinusoids of the log signal-to-noise ratio, and an MLP."""

    _FREQUENCIES = 32

    def __init__(self, width: int) -> None:
        super().__init__()
        self.mlp = nn.Sequential(nn.Linear(2 * self._FREQUENCIES, width), nn.SiLU(), nn.Linear(width, width))

    def forward(self, log_snr: Float[Tensor, "batch"]) -> Float[Tensor, "batch width"]:
        """Return one embedding for each noise level."""
        bands = torch.exp(torch.linspace(0, math.log(100.0), self._FREQUENCIES, device=log_snr.device))
        angles = log_snr[:, None] * bands * 0.1
        return self.mlp(torch.cat([angles.sin(), angles.cos()], dim=-1))
