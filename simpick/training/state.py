"""`TrainingState`: everything that changes from step to step, as it is saved and resumed."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from simpick.errors import SimpickError

Network = TypeVar("Network", bound=nn.Module)


@dataclass
class TrainingState(Generic[Network]):
    """A network in training, the moving average of its weights, its optimiser, and how far the run is."""

    model: Network
    average: AveragedModel
    optimizer: torch.optim.Optimizer
    step: int = 0
    seconds: float = 0.0

    @property
    def averaged_model(self) -> Network:
        """Return the network with the average weights."""
        return cast(Network, self.average.module)

    def descend(
        self, loss: Tensor, max_grad_norm: float, average_gradients: Callable[[nn.Module], None] | None = None
    ) -> None:
        """Take one step down the gradient of `loss`, clipped, and average the weights.

        Raises:
            SimpickError: the loss or its gradient is no longer a number; the weights are those of the step before.
        """
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        if average_gradients is not None:
            average_gradients(self.model)
        norm = float(nn.utils.clip_grad_norm_(self.model.parameters(), max_grad_norm))
        if not math.isfinite(norm):
            raise SimpickError(
                f"the loss is no longer a number at step {self.step}; the state that was saved last is kept. "
                "Start again with a lower learning_rate"
            )
        self.optimizer.step()
        self.step += 1
        self.average.update_parameters(self.model)

    def save(self) -> dict[str, Any]:
        """Return what `load` takes."""
        return {
            "model": self.model.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "step": self.step,
            "seconds": self.seconds,
        }

    def load(self, saved: dict[str, Any]) -> None:
        """Continue from a saved state; raises KeyError, ValueError, RuntimeError or TypeError if it is none of this."""
        step, seconds = saved["step"], saved["seconds"]
        if type(step) is not int or not 0 <= step < 2**63 or not 0 <= float(seconds) < math.inf:
            raise ValueError(f"a state needs a step and seconds of 0 or more, got {step!r} and {seconds!r}"[:200])
        self.model.load_state_dict(saved["model"])
        self.average.load_state_dict(saved["average"])
        self.optimizer.load_state_dict(saved["optimizer"])
        self.step, self.seconds = step, float(seconds)
