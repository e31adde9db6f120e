"""`Distributed`: one training process, or several under torchrun, whose gradients are averaged."""

from __future__ import annotations

import os
from dataclasses import dataclass

import torch
from torch import distributed, nn

from simpick.errors import ConfigError


@dataclass(frozen=True)
class Distributed:
    """One of the processes that train together. A context manager."""

    rank: int
    count: int
    device: torch.device

    @staticmethod
    def from_environment(device: str) -> Distributed:
        """Return the process that torchrun's variables describe, or a single one; `device` is cuda, cpu or auto.

        Raises:
            ConfigError: the device is unknown, or not available.
        """
        if device not in ("auto", "cuda", "cpu"):
            raise ConfigError(f"device must be auto, cuda or cpu, got {device!r}")
        has_cuda = torch.cuda.is_available()
        if device == "cuda" and not has_cuda:
            raise ConfigError("device cuda is not available to torch; use --device cpu")
        rank, count = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
        if device == "cpu" or not has_cuda:
            return Distributed(rank, count, torch.device("cpu"))
        return Distributed(rank, count, torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0"))))

    @property
    def is_first(self) -> bool:
        """Return whether this process writes files."""
        return self.rank == 0

    def average_gradients(self, model: nn.Module) -> None:
        """Replace each gradient by its mean over the processes, in one transfer."""
        if self.count == 1:
            return
        gradients = [p.grad for p in model.parameters() if p.grad is not None]
        flat = torch.cat([g.flatten() for g in gradients])
        distributed.all_reduce(flat)
        for g, mean in zip(gradients, (flat / self.count).split([g.numel() for g in gradients]), strict=True):
            g.copy_(mean.view_as(g))

    def agree(self, *values: float) -> list[float]:
        """Return for each value the largest of all processes, so that all decide the same."""
        if self.count == 1:
            return list(values)
        largest = torch.tensor(values, device=self.device)
        distributed.all_reduce(largest, op=distributed.ReduceOp.MAX)
        return largest.tolist()

    def wait(self) -> None:
        """Return when all processes have called this."""
        self.agree(0.0)

    def __enter__(self) -> Distributed:
        if self.count > 1:
            distributed.init_process_group("nccl" if self.device.type == "cuda" else "gloo")
        return self

    def __exit__(self, *exception: object) -> None:
        if self.count > 1:
            distributed.destroy_process_group()
