"""Checkpoints of the detector: weights as safetensors with facts of their training, loaded strictly."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from safetensors.torch import save as to_bytes

from simpick.caching import atomic_write_bytes
from simpick.errors import CheckpointError
from simpick.estimators.detector.network import InstanceNetwork
from simpick.estimators.detector.scores import MaskScore
from simpick.estimators.weight_files import check_weights, read_weights, shipped_weights
from simpick.json_text import load_json

FORMAT = "simpick-detector"
VERSION = "4"
"""Raised when the same weights would mean something else."""
SHIPPED_WEIGHTS = "detector.safetensors"


@dataclass(frozen=True, eq=False)
class DetectorCheckpoint:
    """A network and the facts of its training."""

    network: InstanceNetwork
    score: MaskScore
    """Fitted to this network."""
    card: dict[str, Any]


def save_detector_checkpoint(path: Path, network: InstanceNetwork, score: MaskScore, card: dict[str, Any]) -> None:
    """Write the card and the weights, those of convolutions in half precision, to one file, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    tensors = {
        # Variances of normalisation exceed the range of half precision.
        name: (value.half() if value.ndim > 1 else value).detach().cpu().contiguous()
        for name, value in network.state_dict().items()
    }
    header = {
        "format": FORMAT,
        "version": VERSION,
        "score": json.dumps([score.intercept, *score.weights]),
        "card": json.dumps(card),
    }
    atomic_write_bytes(path, to_bytes(tensors, header))


def load_detector_checkpoint(path: Path) -> DetectorCheckpoint:
    """Return the network of a checkpoint, ready to detect.

    Raises:
        CheckpointError: the file is missing, damaged, of another network or version, or its weights do not fit.
    """
    header, tensors = read_weights(path, FORMAT, VERSION, "simpick's detector")
    try:
        score, card = _score(load_json(header["score"])), load_json(header["card"])
        if not isinstance(card, dict):
            raise ValueError("it must be an object")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise CheckpointError(f"the card of {path} cannot be read ({error}); get the file again") from error
    network = InstanceNetwork()
    check_weights(path, tensors, network.state_dict(), "simpick's detector")
    network.load_state_dict({name: t.float() if t.is_floating_point() else t for name, t in tensors.items()})
    return DetectorCheckpoint(network.eval(), score, card)


def _score(values: Any) -> MaskScore:
    """Return the score of these numbers, the intercept first; raises ValueError if they are others."""
    count = 1 + len(MaskScore().weights)
    if not isinstance(values, list) or len(values) != count or not {type(value) for value in values} <= {int, float}:
        raise ValueError(f"the score must be {count} numbers, got {values!r}"[:200])
    intercept, *weights = (float(value) for value in values)
    if not np.isfinite([intercept, *weights]).all():
        raise ValueError(f"the score's weights must be finite, got {[intercept, *weights]}")
    return MaskScore(intercept, tuple(weights))


def shipped_detector_checkpoint() -> Path:
    """Return the file of the weights that are part of simpick.

    Raises:
        CheckpointError: this installation has none.
    """
    return shipped_weights(SHIPPED_WEIGHTS, "the detector", "simpick train detector")
