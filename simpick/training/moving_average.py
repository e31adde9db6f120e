"""The exponential moving average (EMA) of a model's weights."""

from __future__ import annotations

from torch import Tensor, nn
from torch.optim.swa_utils import PARAM_LIST, AveragedModel, get_ema_multi_avg_fn


def moving_average(model: nn.Module, decay: float) -> AveragedModel:
    """Return the average of a model's parameters, in evaluation mode; call `update_parameters` after each step.

    The decay of update n is at most (1 + n) / (10 + n), so that the initial weights are forgotten early.
    """

    def average(averaged: PARAM_LIST, current: PARAM_LIST, updates: Tensor | int) -> None:
        n = int(updates)
        get_ema_multi_avg_fn(min(decay, (1 + n) / (10 + n)))(averaged, current, updates)

    averaged = AveragedModel(model, multi_avg_fn=average)
    # Its first update copies the parameters instead of averaging them.
    averaged.update_parameters(model)
    return averaged.eval()
