"""What a step draws: its views, and the crops of each. It follows from seed, step and bins, whoever cuts the crops."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from simpick.training.detector.config import DetectorTrainConfig
from simpick.training.detector.crop_plans import Areas, CropPlan, draw_plan

View = tuple[Path, int]
"""A bin's file and one of its views."""


def draw_views(config: DetectorTrainConfig, step: int, files: Sequence[Path]) -> list[View]:
    """Return the views that a step's crops are taken from, of bins in these files."""
    rng = np.random.default_rng([config.seed, 16, step])
    number = -(-config.batch // config.crops_per_view)
    return [(files[int(rng.integers(len(files)))], int(rng.integers(config.data.views))) for _ in range(number)]


def view_rng(config: DetectorTrainConfig, step: int, place: int) -> np.random.Generator:
    """Return the generator of the crops of a step's view at this place among its views."""
    return np.random.default_rng([config.seed, 17, step, place])


def draw_plans(config: DetectorTrainConfig, place: int, areas: Areas, rng: np.random.Generator) -> list[CropPlan]:
    """Return the crops of a step's view at this place, which shows instances of these areas."""
    number = min(config.crops_per_view, config.batch - place * config.crops_per_view)
    return [draw_plan(areas, config.crops, rng) for _ in range(number)]
