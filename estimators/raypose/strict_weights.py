"""Strict check of weights from files: they must fit a network exactly, in shape and type, and be finite."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch
from torch import Tensor

from simpick.errors import CheckpointError


def check_weights(path: Path, tensors: Mapping[str, Tensor], expected: Mapping[str, Tensor], owner: str) -> None:
    """Raise CheckpointError unless `tensors` of the file `path` are those of `owner`, whose tensors are `expected`."""
    problems = [f"{name} is missing" for name in expected if name not in tensors]
    problems += [f"{name} is unknown" for name in tensors if name not in expected]
    problems += [
        f"{name} must have shape {tuple(expected[name].shape)}, got {tuple(tensor.shape)}"
        for name, tensor in tensors.items()
        if name in expected and expected[name].shape != tensor.shape
    ]
    problems += [
        f"{name} must hold {_kind(expected[name].dtype)}, got {tensor.dtype}"
        for name, tensor in tensors.items()
        if name in expected and _kind(expected[name].dtype) != _kind(tensor.dtype)
    ]
    if problems:
        more = f" and {len(problems) - 3} more" if len(problems) > 3 else ""
        raise CheckpointError(f"the weights in {path} do not fit {owner}: {'; '.join(problems[:3])}{more}")
    if not all(bool(tensor.isfinite().all()) for tensor in tensors.values()):
        raise CheckpointError(f"the weights in {path} must be finite numbers; get the file again")


def _kind(dtype: torch.dtype) -> str:
    """Return what a type holds: converting between types of one kind loses digits, never meaning."""
    return "real numbers" if dtype.is_floating_point else str(dtype)
