"""From conditioning to poses: sample every template's maps and decode them."""

from __future__ import annotations

import torch

from simpick.estimators.raypose.diffusion.sampler import sample
from simpick.estimators.raypose.diffusion.schedule import Schedule
from simpick.estimators.raypose.network.model import Conditioning, RayPose
from simpick.estimators.raypose.network.pose_maps import CHANNELS, ViewPoses, decode_pose_maps


def sample_views(
    model: RayPose, conditioning: Conditioning, schedule: Schedule, steps: int, generator: torch.Generator
) -> ViewPoses:
    """Return every template's hypothesis, leading dimensions (batch, views); noise comes from `generator`."""
    cells, reference = model.config.map_cells, conditioning.reference
    shape = (*reference.half_extent_at_depth_m.shape, cells, cells, CHANNELS)
    # The same noise for every query, so that an answer does not depend on its place in the batch.
    noise = torch.randn(shape[1:], generator=generator).to(reference.half_extent_at_depth_m.device).expand(shape)
    maps = sample(lambda noisy, log_snr: model.denoise(noisy, log_snr, conditioning), noise, schedule, steps)
    return decode_pose_maps(maps.float(), reference, model.config.padding)
