"""Weights in safetensors files: read with their header, and loaded strictly.

They must fit a network exactly, in shape and type, and be finite.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path

import safetensors
import torch
from torch import Tensor

from simpick.errors import CheckpointError


def read_weights(path: Path, form: str, version: str, owner: str) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Return header and tensors of a checkpoint that is of format `form` and this version; `owner` is named in errors.

    Raises:
        CheckpointError: the file is missing, damaged, of another format or version.
    """
    if not path.is_file():
        raise CheckpointError(f"there is no checkpoint {path}; give the path of a .safetensors file of simpick")
    try:
        with safetensors.safe_open(str(path), framework="pt") as file:
            header = file.metadata() or {}
            ours = header.get("format") == form and header.get("version") == version
            tensors = {name: file.get_tensor(name) for name in file.keys()} if ours else {}  # noqa: SIM118 - no mapping
    except (safetensors.SafetensorError, OSError, ValueError) as error:
        raise CheckpointError(f"{path} is damaged or no safetensors file ({error}); get it again") from error
    if header.get("format") != form:
        raise CheckpointError(
            f"{path} must be a checkpoint of {owner}, but its format is {header.get('format', 'not given')!r}"
        )
    if not ours:
        raise CheckpointError(
            f"{path} must be of version {version}, got {header.get('version')!r}; use the simpick that wrote it"
        )
    return header, tensors


def shipped_weights(name: str, owner: str, command: str) -> Path:
    """Return a file of weights that is part of simpick. Raises `CheckpointError` if this installation lacks it."""
    path = Path(str(files("simpick.assets.weights").joinpath(name)))
    if not path.exists():
        raise CheckpointError(
            f"this installation has no weights of {owner} ({name} is missing); train some with: {command}, and pass "
            "them as weights"
        )
    return path


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
