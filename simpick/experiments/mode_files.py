"""The files that a perception mode's answers depend on: weights, and what else was fitted to data and ships."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from pathlib import Path

from simpick.estimators.raypose.checkpoints import shipped_checkpoint
from simpick.estimators.refiner.confidence import SHIPPED_FILE as CONFIDENCE_FILE
from simpick.experiments.perceptions import ENTRY_POINT_GROUP
from simpick.experiments.run_config import RunConfig

FILES_OF_PERCEPTION: dict[str, Callable[[], Sequence[Path]]] = {
    "oracle": lambda: (),
    "retrieval": lambda: (),
    "retrieval_refined": lambda: (CONFIDENCE_FILE,),
    "coarse": lambda: (shipped_checkpoint(),),
    "fine": lambda: (shipped_checkpoint(),),
    "refined": lambda: (shipped_checkpoint(), CONFIDENCE_FILE),
}
"""By the name of a perception that comes with simpick. Add to a line what its estimator reads, and nothing else."""


def mode_data(config: RunConfig) -> dict[str, str]:
    """Return a hash of each file behind a run's perception, by the file's name; files that do not exist are left out.

    For a perception of another package, whose files nobody here knows, it is that package's version.

    Raises:
        CheckpointError: this installation has no weights, and the mode needs them.
    """
    if config.perception in FILES_OF_PERCEPTION:
        found = [file for file in FILES_OF_PERCEPTION[config.perception]() if file.is_file()]
        return {file.name: hashlib.sha256(file.read_bytes()).hexdigest()[:16] for file in found}
    owners = (entry.dist for entry in entry_points(group=ENTRY_POINT_GROUP) if entry.name == config.perception)
    return {f"package {dist.name}": dist.version for dist in owners if dist is not None}
