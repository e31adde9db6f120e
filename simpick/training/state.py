"""`TrainingState`: everything that changes from step to step, as it is saved and resumed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

import torch
from torch import nn
from torch.optim.swa_utils import AveragedModel

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
        """Continue from a saved state; raises KeyError, ValueError or RuntimeError if it is of another network."""
        self.model.load_state_dict(saved["model"])
        self.average.load_state_dict(saved["average"])
        self.optimizer.load_state_dict(saved["optimizer"])
        self.step, self.seconds = saved["step"], saved["seconds"]
