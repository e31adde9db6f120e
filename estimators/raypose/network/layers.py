"""Layers of fuser and decoder: attention, MLP, and the DiT block with adaLN-Zero (Peebles and Xie, ICCV 2023)."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional as F

KeysValues = tuple[Tensor, Tensor]
"""Keys and values, each (..., heads, tokens, width / heads)."""


class Attention(nn.Module):
    """Multi-head attention whose keys and values can be computed once and used many times."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.to_q = nn.Linear(width, width)
        self.to_kv = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def keys_values(self, tokens: Float[Tensor, "*batch tokens width"]) -> KeysValues:
        """Return what `forward` needs of the tokens that are attended to."""
        k, v = self.to_kv(tokens).chunk(2, dim=-1)
        return self._split(k), self._split(v)

    def forward(self, x: Float[Tensor, "*batch tokens width"], kv: KeysValues) -> Float[Tensor, "*batch tokens width"]:
        """Return what each token gathers from the keys and values of its batch."""
        # Torch's fused kernels take four dimensions.
        q, k, v = (heads.flatten(0, -4) for heads in (self._split(self.to_q(x)), *kv))
        attended = F.scaled_dot_product_attention(q, k, v)
        return self.out(attended.transpose(1, 2).flatten(2)).reshape(x.shape)

    def _split(self, x: Tensor) -> Tensor:
        return x.unflatten(-1, (self.heads, -1)).transpose(-2, -3)  # (..., heads, tokens, width / heads)


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

    def forward(self, x: Float[Tensor, "*batch tokens width"]) -> Float[Tensor, "*batch tokens width"]:
        """Return the tokens after self-attention and MLP."""
        h = self.norm_attention(x)
        x = x + self.attention(h, self.attention.keys_values(h))
        return x + self.mlp(self.norm_mlp(x))


def modulate(x: Tensor, shift: Tensor, scale: Tensor) -> Tensor:
    """Return x (1 + scale) + shift."""
    return x * (1 + scale) + shift


def adaln_modulation(width: int, chunks: int) -> nn.Sequential:
    """Return the layer that predicts shifts, scales and gates; all of them start at zero."""
    linear = nn.Linear(width, chunks * width)
    nn.init.zeros_(linear.weight)
    nn.init.zeros_(linear.bias)
    return nn.Sequential(nn.SiLU(), linear)


class DiTBlock(nn.Module):
    """Self-attention within each view, cross-attention to the context, and MLP, conditioned by adaLN-Zero."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.norm_self = nn.LayerNorm(width, elementwise_affine=False)
        self.self_attention = Attention(width, heads)
        self.norm_cross = nn.LayerNorm(width, elementwise_affine=False)
        self.cross_attention = Attention(width, heads)
        self.norm_mlp = nn.LayerNorm(width, elementwise_affine=False)
        self.mlp = mlp(width)
        self.adaLN_modulation = adaln_modulation(width, 9)

    def forward(
        self, x: Float[Tensor, "batch views tokens width"], context: KeysValues, timestep: Float[Tensor, "batch width"]
    ) -> Float[Tensor, "batch views tokens width"]:
        """Return the tokens after one block; `timestep` is the embedded noise level."""
        shift_s, scale_s, gate_s, shift_c, scale_c, gate_c, shift_m, scale_m, gate_m = self.adaLN_modulation(timestep)[
            :, None, None
        ].chunk(9, dim=-1)  # each (batch, 1, 1, width)
        h = modulate(self.norm_self(x), shift_s, scale_s)
        x = x + gate_s * self.self_attention(h, self.self_attention.keys_values(h))
        h = modulate(self.norm_cross(x), shift_c, scale_c).flatten(1, 2)  # (batch, views * tokens, width)
        x = x + gate_c * self.cross_attention(h, context).view(x.shape)
        h = modulate(self.norm_mlp(x), shift_m, scale_m)
        return x + gate_m * self.mlp(h)


class TimestepEmbedder(nn.Module):
    """Sinusoids of the log signal-to-noise ratio, and an MLP."""

    _FREQUENCIES = 32

    def __init__(self, width: int) -> None:
        super().__init__()
        self.mlp = nn.Sequential(nn.Linear(2 * self._FREQUENCIES, width), nn.SiLU(), nn.Linear(width, width))

    def forward(self, log_snr: Float[Tensor, "batch"]) -> Float[Tensor, "batch width"]:
        """Return one embedding per noise level."""
        bands = torch.exp(torch.linspace(0, math.log(100.0), self._FREQUENCIES, device=log_snr.device))
        angles = log_snr[:, None] * bands * 0.1
        return self.mlp(torch.cat([angles.sin(), angles.cos()], dim=-1))
