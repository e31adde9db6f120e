"""Checkpoints: weights as safetensors with the whole configuration inside, loaded strictly."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import safetensors
import torch
from safetensors.torch import save as to_bytes

from simpick.caching import atomic_write_bytes
from simpick.config import from_json
from simpick.errors import CheckpointError
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.strict_weights import check_weights
from simpick.json_text import load_json

FORMAT = "simpick-raypose"
VERSION = "4"
"""Raised when the same weights would mean something else or have other names."""
SHIPPED_WEIGHTS = "raypose.safetensors"
_FROZEN = "image_encoder.vit."


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A network and the card that describes its training."""

    model: RayPose
    card: dict[str, Any]
    """Samples, hours, data, figures."""


def save_checkpoint(path: Path, model: RayPose, card: dict[str, Any]) -> None:
    """Write weights in half precision, configuration and card to one file, whole or not at all.

    A frozen image encoder is left out, because simpick does not distribute its weights.

    Raises:
        OutputError: the file cannot be written.
    """
    tensors = {
        name: tensor.detach().cpu().half().contiguous()
        for name, tensor in model.state_dict().items()
        if not name.startswith(_FROZEN)
    }
    header = {
        "format": FORMAT,
        "version": VERSION,
        "config": json.dumps(model.config.to_json()),
        "card": json.dumps(card),
    }
    atomic_write_bytes(path, to_bytes(tensors, header))


def load_checkpoint(path: Path, *, dino_weights: Path | None = None) -> Checkpoint:
    """Return the network of a checkpoint, ready to estimate.

    Raises:
        CheckpointError: the file is missing, damaged, foreign, of another version, or its weights do not fit its
            configuration; or it needs DINOv2's weights and none are given.
    """
    header, tensors = _read(path)
    try:
        config = from_json(RayPoseConfig, load_json(header["config"]), complete=True)
        card = load_json(header["card"])
        if not isinstance(card, dict):
            raise ValueError("it must be an object")
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(f"the configuration in {path} cannot be read ({error}); get the file again") from error
    model = RayPose(config)
    expected = {name: tensor for name, tensor in model.state_dict().items() if not name.startswith(_FROZEN)}
    check_weights(path, tensors, expected, "their configuration")
    model.load_state_dict({name: tensor.float() for name, tensor in tensors.items()}, strict=not config.is_dino)
    if config.is_dino:
        from simpick.estimators.raypose.network.encoders.dino_encoder import load_dino_weights

        if dino_weights is None:
            raise CheckpointError(
                f"{path} needs the weights of {config.image_encoder}, which are not part of it: pass a local file "
                "(safetensors or .pth) as dino_weights"
            )
        load_dino_weights(model.image_encoder, dino_weights)
    return Checkpoint(model.eval(), card)


def shipped_checkpoint() -> Path:
    """Return the file of the weights that come with simpick, for ``coarse`` and ``fine``.

    Raises:
        CheckpointError: this installation has none.
    """
    path = Path(str(files("simpick.assets.weights").joinpath(SHIPPED_WEIGHTS)))
    if not path.exists():
        raise CheckpointError(
            f"this installation has no weights ({path.name} is missing); train some with: simpick train fine, and pass "
            "them as weights"
        )
    return path


def _read(path: Path) -> tuple[dict[str, str], dict[str, torch.Tensor]]:
    if not path.is_file():
        raise CheckpointError(f"there is no checkpoint {path}; give the path of a .safetensors file of simpick")
    try:
        with safetensors.safe_open(str(path), framework="pt") as file:
            header = file.metadata() or {}
            ours = header.get("format") == FORMAT and header.get("version") == VERSION
            tensors = {name: file.get_tensor(name) for name in file.keys()} if ours else {}  # noqa: SIM118 - no mapping
    except (safetensors.SafetensorError, OSError, ValueError) as error:
        raise CheckpointError(f"{path} is damaged or no safetensors file ({error}); get it again") from error
    if header.get("format") != FORMAT:
        raise CheckpointError(
            f"{path} must be a checkpoint of RayPose written by simpick, but its format is "
            f"{header.get('format', 'not given')!r}"
        )
    if not ours:
        raise CheckpointError(
            f"{path} must be of version {VERSION}, got {header.get('version')!r}; use the simpick that wrote it"
        )
    return header, tensors
