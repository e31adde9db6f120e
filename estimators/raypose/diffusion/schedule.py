"""Noise schedules: the signal-to-noise ratio of each timestep, independent of networks and losses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from simpick.errors import ConfigError, UnknownNameError

TIMESTEPS = 100
"""T of the paper's equations, as in RayDiffusion."""
SCHEDULES = ("log_snr", "cosine", "linear")


@dataclass(frozen=True, eq=False)
class Schedule:
    """log(alpha_t / (1 - alpha_t)) of the timesteps 1 to T, which falls.

    M_t = sqrt(alpha_t) M_0 + sqrt(1 - alpha_t) eps (paper, eq. 6).
    """

    log_snrs: Float[Tensor, "timesteps"]

    def __post_init__(self) -> None:
        if len(self.log_snrs) < 1 or not bool((self.log_snrs.diff() < 0).all()):
            raise ConfigError("a schedule's log-SNR must fall from step to step, and there must be a step")

    def __len__(self) -> int:
        return len(self.log_snrs)

    def sampling_steps(self, count: int) -> Int[Tensor, "count"]:
        """Return `count` different timesteps (from 0), the noisiest first, evenly spread; raises ConfigError."""
        if not 1 <= count <= len(self):
            raise ConfigError(f"denoising steps must be between 1 and {len(self)}, got {count}")
        return len(self) - 1 - torch.arange(count) * len(self) // count


def make_schedule(name: str = "log_snr", timesteps: int = TIMESTEPS) -> Schedule:
    """Return a schedule by name.

    ``log_snr``: uniform from +2 to -9, our default. A p x p map repeats one pose p^2 times, so that noise of the usual
    strength averages out and most steps of a standard schedule give no reason to use the image. ``cosine``: Nichol and
    Dhariwal, 2021. ``linear``: betas from 1e-4 to 0.2, as in RayDiffusion.

    Raises:
        UnknownNameError: there is no such schedule.
    """
    t = torch.arange(1, timesteps + 1, dtype=torch.float64) / timesteps
    if name == "log_snr":
        return Schedule(torch.linspace(2.0, -9.0, timesteps))
    if name == "cosine":
        alpha = (torch.cos((t + 0.008) / 1.008 * math.pi / 2) / math.cos(0.008 / 1.008 * math.pi / 2)).square()
        alpha = alpha.clamp(1e-5, 1 - 1e-5)
        # The clamp must not make steps equal.
        return Schedule((torch.logit(alpha) - 1e-6 * torch.arange(timesteps)).float())
    if name == "linear":
        alpha = (1 - torch.linspace(1e-4, 0.2, timesteps, dtype=torch.float64)).cumprod(0)
        return Schedule(torch.logit(alpha).float())
    raise UnknownNameError("noise schedule", name, SCHEDULES)
