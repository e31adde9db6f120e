"""The x0 parameterization: the network predicts the clean maps M_0 (paper, eq. 10); noisy maps and noise follow."""

from __future__ import annotations

from jaxtyping import Float
from torch import Tensor


def add_noise(
    clean: Float[Tensor, "batch *shape"], noise: Float[Tensor, "batch *shape"], log_snr: Float[Tensor, "batch"]
) -> Float[Tensor, "batch *shape"]:
    """Return M_t = sqrt(alpha) M_0 + sqrt(1 - alpha) eps (paper, eq. 6)."""
    signal, spread = amplitudes(log_snr, clean.ndim)
    return signal * clean + spread * noise


def implied_noise(
    noisy: Float[Tensor, "batch *shape"], clean: Float[Tensor, "batch *shape"], log_snr: Float[Tensor, "batch"]
) -> Float[Tensor, "batch *shape"]:
    """Return the noise that must have been added to `clean` to give `noisy`."""
    signal, spread = amplitudes(log_snr, clean.ndim)
    return (noisy - signal * clean) / spread


def amplitudes(log_snr: Float[Tensor, "batch"], ndim: int) -> tuple[Tensor, Tensor]:
    """Return sqrt(alpha) and sqrt(1 - alpha), shaped to be multiplied with `ndim` dimensions."""
    shape = (-1, *([1] * (ndim - 1)))
    return log_snr.sigmoid().sqrt().view(shape), (-log_snr).sigmoid().sqrt().view(shape)
