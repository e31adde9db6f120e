"""Detectors by name: the simulator's own masks, the learned detector, and detectors that other packages register.

=============  ========================================================================================================
``perfect``    the simulator's visible masks: an upper bound
``realistic``  the same with missed and merged parts, ragged masks and inaccurate boxes
``box``        perfect boxes without masks
``learned``    found in the image by the shipped network, which has never seen the parts
NAME           a detector of another package
FILE.json      in BOP's format, for images that exist already: a BOP data set or the pose benchmark's bins
=============  ========================================================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from simpick.bop.detections_json import read_detections
from simpick.errors import ConfigError, UnknownNameError
from simpick.estimators.base import Detector
from simpick.estimators.detection_noise import DETECTION_PRESETS
from simpick.estimators.plugins import Plugin, entries_of, file_hash, make_plugin
from simpick.estimators.segmentation_detector import SegmentationDetector

ENTRY_POINT_GROUP = "simpick.detectors"
"""Where another package registers its detector: a callable without arguments that returns a `Detector`."""


TRIED = 4
"""Detections whose poses are estimated for each one to report: poses are judged more reliably than detections."""


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


def _pose_weights() -> Path:
    from simpick.estimators.raypose.checkpoints import shipped_checkpoint

    return shipped_checkpoint()


SHIPPED: dict[str, DetectorSpec] = {"learned": DetectorSpec(_learned, files=(_detector_weights, _pose_weights))}
"""The detectors that ship with simpick and work from images alone, by name."""


def detector_names() -> list[str]:
    """Return every name that detections can be asked for by."""
    return [*DETECTION_PRESETS, *SHIPPED, *entries_of(ENTRY_POINT_GROUP)]


def is_simulated(name: str) -> bool:
    """Return whether these detections come from the simulator's instance ids instead of from the image."""
    return name in DETECTION_PRESETS


def labelled(name: str) -> str:
    """Return the name of these detections for tables, which states where they are simulated or an upper bound."""
    note = {"perfect": " (simulated, an upper bound)"}.get(name, " (simulated)" if is_simulated(name) else "")
    return f"{name} detections{note}"


def is_file(name: str) -> bool:
    """Return whether these detections are read from a file."""
    return name.endswith((".json", ".json.gz"))


def find_detector(name: str) -> DetectorSpec:
    """Return the row of a detector that works from images alone.

    Raises:
        UnknownNameError: there is none of this name; the message lists those that exist, simulated ones included.
    """
    if name in SHIPPED:
        return SHIPPED[name]
    if (entry := entries_of(ENTRY_POINT_GROUP).get(name)) is not None:
        return DetectorSpec(lambda: make_plugin(entry, Detector), entry=entry)
    raise UnknownNameError(
        "detections", name, detector_names(), f"Other packages add theirs as entry points of {ENTRY_POINT_GROUP!r}."
    )


def photo_detector(name: str, *, counted: bool = False) -> Detector:
    """Return the detector called `name` as photographs need it.

    Who asks for parts in a photograph expects them there, so the learned detector answers also where the image as a
    whole probably shows none of them, with what has a probability of a tenth or more; `simpick.photos` says where
    no pose is probable. If it is known how many of each part the image shows (`counted`), nothing is left out
    for its probability: the most certain are chosen anyway.

    Raises:
        UnknownNameError: there is none of this name.
    """
    if name == "learned":
        from simpick.estimators.detector import LearnedDetector, LearnedDetectorConfig

        return LearnedDetector(config=LearnedDetectorConfig(min_score=0.0 if counted else 0.1, min_presence=0.0))
    return find_detector(name).make()


def detector_data(name: str) -> dict[str, str]:
    """Return what these detections depend on beside their name: hashes of files, or another package's version.

    Raises:
        UnknownNameError: there are no such detections.
        CheckpointError: weights are needed, and this installation has none.
        DatasetError: it is a file that is missing or is not of BOP's format.
    """
    if is_file(name):
        read_detections(Path(name))
        return {Path(name).name: file_hash(Path(name))}
    return {} if is_simulated(name) else find_detector(name).data()


def make_detector(
    name: str, instance_parts: Sequence[str] | Callable[[], Sequence[str]], rng: np.random.Generator
) -> Detector:
    """Return a detector by name; simulated ones take the part of each instance from `instance_parts`.

    Raises:
        UnknownNameError: there are no such detections.
        CheckpointError: weights are needed, and this installation has none.
        ConfigError: it is a file, which holds detections of given images only.
    """
    if is_file(name):
        raise ConfigError(
            f"detections must be a detector's name here, got the file {name!r}: it holds detections of images that "
            "exist already, and a robot changes the bin with each pick. Take learned, or register your detector "
            f"({ENTRY_POINT_GROUP!r}); a file is for simpick evaluate --dataset and simpick pose-benchmark"
        )
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
