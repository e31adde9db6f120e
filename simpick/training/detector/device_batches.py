"""Batches of crops that are cut on the training's device, from the same draws as those of the loader processes."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

import numpy as np
import torch

from simpick.training.detector.batches import CropBatch
from simpick.training.detector.config import DetectorTrainConfig
from simpick.training.detector.crop_plans import CropPlan
from simpick.training.detector.device_views import DeviceViews
from simpick.training.detector.step_draws import draw_plans, draw_views, view_rng
from simpick.training.detector.tensor_crops import cut_crops
from simpick.training.detector.tensor_effects import apply_tensor_effects


def device_batches(config: DetectorTrainConfig, views: DeviceViews, first_step: int) -> Iterator[CropBatch]:
    """Yield the batches of the steps from `first_step`, on the device of the views.

    As long as the same bins are ready, so is a step's batch. It shows the crops of `crop_batches`, but for rounding and
    for the noise, which the device draws.
    """
    noise = torch.Generator(views.device)
    for step in count(first_step):
        rows, plans = list[int](), list[CropPlan]()
        for place, view in enumerate(draw_views(config, step, views.ready())):
            drawn = draw_plans(config, place, views.areas(view), view_rng(config, step, place))
            rows += [views.row(view)] * len(drawn)
            plans += drawn
        index = torch.tensor(rows, device=views.device)
        rgb, ids = cut_crops(views.rgb[index], views.ids[index], views.blanks[index], plans, config.crops.size_px)
        noise.manual_seed(int(np.random.default_rng([config.seed, 18, step]).integers(2**63)))
        exposures, qualities = [plan.exposure for plan in plans], [plan.jpeg_quality for plan in plans]
        yield CropBatch(apply_tensor_effects(rgb, exposures, qualities, noise), ids)
