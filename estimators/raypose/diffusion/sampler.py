"""Sampling: from pure noise to clean maps by deterministic DDIM steps (Song et al. 2021) with a denoiser of M_0.

Departure from the paper: its reverse step (eq. 7) is stochastic and written for predicted noise, although its loss
(eq. 10) predicts M_0; this step is deterministic and follows from predicting M_0.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

from simpick.estimators.raypose.diffusion.schedule import Schedule
from simpick.estimators.raypose.diffusion.x0_parameterization import add_noise, implied_noise


@runtime_checkable
class Denoiser(Protocol):
    """Predicts clean maps from noisy ones."""

    def __call__(
        self, noisy: Float[Tensor, "batch *shape"], log_snr: Float[Tensor, "batch"]
    ) -> Float[Tensor, "batch *shape"]:
        """Return the clean maps."""
        ...


def sample(
    denoiser: Denoiser, noise: Float[Tensor, "batch *shape"], schedule: Schedule, steps: int
) -> Float[Tensor, "batch *shape"]:
    """Return clean maps; the same `noise` (unit Gaussian) gives the same maps.

    Raises:
        ConfigError: the schedule has fewer steps.
    """
    log_snrs = schedule.log_snrs[schedule.sampling_steps(steps)].tolist()
    maps = clean = noise
    for now, after in zip(log_snrs, [*log_snrs[1:], None], strict=True):
        level = noise.new_full((len(noise),), now)
        clean = denoiser(maps, level)
        if after is not None:
            maps = add_noise(clean, implied_noise(maps, clean, level), noise.new_full((len(noise),), after))
    return clean
