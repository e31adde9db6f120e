"""Detectors by name: the simulator's own masks, the learned detector, and detectors that other packages register.

=============  ========================================================================================================
``perfect``    the simulator's visible masks: an upper bound
``realistic``  the same with missed and merged parts, ragged masks and inaccurate boxes
``box``        perfect boxes without masks
``learned``    found in the image by the shipped network, which has never seen the parts
NAME           a detector of another package
=============  ========================================================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from simpick.errors import UnknownNameError
from simpick.estimators.base import Detector
from simpick.estimators.detection_noise import DETECTION_PRESETS
from simpick.estimators.plugins import Plugin, entries_of, load_entry
from simpick.estimators.segmentation_detector import SegmentationDetector

ENTRY_POINT_GROUP = "simpick.detectors"
"""Where another package registers its detector: a callable without arguments that returns a `Detector`."""


@dataclass(frozen=True)
class DetectorSpec(Plugin):
    """How a detector that works from images alone is made, and what its answers depend on."""

    make: Callable[[], Detector]
    """Imports heavy libraries itself."""


def _learned() -> Detector:
    from simpick.estimators.detector import LearnedDetector

    return LearnedDetector()


def _detector_weights() -> Path:
    from simpick.estimators.detector.checkpoints import shipped_detector_checkpoint

    return shipped_detector_checkpoint()


SHIPPED: dict[str, DetectorSpec] = {"learned": DetectorSpec(_learned, files=(_detector_weights,))}
"""The detectors that ship with simpick and work from images alone, by name."""


def detector_names() -> list[str]:
    """Return every name that detections can be asked for by."""
    return [*DETECTION_PRESETS, *SHIPPED, *entries_of(ENTRY_POINT_GROUP)]


def is_simulated(name: str) -> bool:
    """Return whether these detections come from the simulator's instance ids instead of from the image."""
    return name in DETECTION_PRESETS


def find_detector(name: str) -> DetectorSpec:
    """Return the row of a detector that works from images alone.

    Raises:
        UnknownNameError: there is none of this name; the message lists those that exist, simulated ones included.
    """
    if name in SHIPPED:
        return SHIPPED[name]
    if (entry := entries_of(ENTRY_POINT_GROUP).get(name)) is not None:
        return DetectorSpec(load_entry(entry), entry=entry)
    raise UnknownNameError(
        "detections", name, detector_names(), f"Other packages add theirs as entry points of {ENTRY_POINT_GROUP!r}."
    )


def detector_data(name: str) -> dict[str, str]:
    """Return what these detections depend on beside their name: hashes of weights, or another package's version.

    Raises:
        UnknownNameError: there are no such detections.
        CheckpointError: weights are needed, and this installation has none.
    """
    return {} if is_simulated(name) else find_detector(name).data()


def make_detector(
    name: str, instance_parts: Sequence[str] | Callable[[], Sequence[str]], rng: np.random.Generator
) -> Detector:
    """Return a detector by name; simulated ones take the part of each instance from `instance_parts`.

    Raises:
        UnknownNameError: there are no such detections.
        CheckpointError: weights are needed, and this installation has none.
    """
    if is_simulated(name):
        return SegmentationDetector(name, rng, instance_parts=instance_parts)
    return _shared(name) if name in SHIPPED else find_detector(name).make()


@cache
def _shared(name: str) -> Detector:
    """Return the one detector of that name in this process, so that weights are read and parts onboarded once.

    Only for those that ship, which keep nothing else between images: another package's detector may keep more, and
    the results of an episode must not depend on the episodes before it.
    """
    return SHIPPED[name].make()
