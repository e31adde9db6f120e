"""`DetectorResources`: what a training run of the detector uses of its machine."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from simpick.config import NonNegativeInt
from simpick.training.resources import Resources


@dataclass(frozen=True)
class DetectorResources(Resources):
    """What a run uses of its machine; results do not depend on it, except for rounding and the noise in crops."""

    loaders: NonNegativeInt = 0
    """Processes that cut crops (0: the training process does), or threads that read bins for crops on the device."""
    crops: Literal["auto", "device", "loaders"] = "auto"
    """Where crops are cut: by loaders, or on the device, which then holds all views; auto: on a GPU where those fit."""
