"""Checkpoints: weights as safetensors with the whole configuration inside, loaded strictly."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safetensors.torch import save as to_bytes

from simpick.caching import atomic_write_bytes
from simpick.config import from_json
from simpick.errors import CheckpointError
from simpick.estimators.raypose.network.config import RayPoseConfig
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.weight_files import check_weights, read_weights, shipped_weights
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
    header, tensors = read_weights(path, FORMAT, VERSION, "RayPose written by simpick")
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
    return shipped_weights(SHIPPED_WEIGHTS, "RayPose", "simpick train fine")
