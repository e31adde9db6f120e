"""What an agent sees and does in `BinPickEnv`: one table makes the observation space and its documentation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces

from simpick.records import PickOutcome
from simpick.scene.config import MAX_PARTS

OUTCOMES: tuple[PickOutcome, ...] = tuple(PickOutcome)
"""The order in which outcomes are numbered in observations, from 1; 0 stands for "no pick yet"."""

FAR_M = 10.0
"""Depth beyond which a camera reports no reading; no camera stands farther from the arm's base."""
FAR_PX = 1e5
"""Upper bound of focal lengths and principal points."""


@dataclass(frozen=True)
class ObservationItem:
    """One row of the observation table."""

    key: str
    meaning: str
    unit: str
    space: spaces.Space


def observation_table(width: int, height: int) -> tuple[ObservationItem, ...]:
    """Return the rows for an overhead camera of this size."""
    box = spaces.Box
    return (
        ObservationItem("rgb", "overhead image", "", box(0, 255, (height, width, 3), np.uint8)),
        ObservationItem(
            "depth",
            "distance along the optical axis; 0 = no reading",
            "m",
            box(0.0, FAR_M, (height, width), np.float32),
        ),
        ObservationItem(
            "segmentation",
            "1 + instance id of the part in each pixel, as a detector would see it; 0 = no part",
            "",
            box(0, MAX_PARTS, (height, width), np.uint8),
        ),
        ObservationItem(
            "instance_parts",
            "for each instance id its index into `BinPickEnv.part_names`; -1 pads to the greatest count",
            "",
            box(-1, MAX_PARTS - 1, (MAX_PARTS,), np.int16),
        ),
        ObservationItem(
            "camera_matrix", "intrinsics K, pixel centres at +0.5", "px", box(0.0, FAR_PX, (3, 3), np.float64)
        ),
        ObservationItem(
            "T_world_camera", "camera pose, OpenCV axes (+z forward)", "m", box(-FAR_M, FAR_M, (4, 4), np.float64)
        ),
        ObservationItem("remaining", "parts still in the bin", "", spaces.Discrete(MAX_PARTS + 1)),
        ObservationItem(
            "last_outcome",
            "how the last pick ended: 0 = no pick yet, else 1 + index into `OUTCOMES`",
            "",
            spaces.Discrete(len(OUTCOMES) + 1),
        ),
    )


def observation_space(width: int, height: int) -> spaces.Dict:
    """Return the observation space for an overhead camera of this size."""
    return spaces.Dict({item.key: item.space for item in observation_table(width, height)})


def action_space() -> spaces.Box:
    """Return the action space: TCP position (3), 6D rotation (6) and opening (1), all in [-1, 1]."""
    return spaces.Box(-1.0, 1.0, (10,), np.float32)


def outcome_index(outcome: PickOutcome | None) -> int:
    """Return the observation's number of an outcome; 0 for None."""
    return 0 if outcome is None else 1 + OUTCOMES.index(outcome)


def outcome_from_index(index: int) -> PickOutcome | None:
    """Return the outcome behind the observation's number; None for 0."""
    return None if index == 0 else OUTCOMES[index - 1]


def observation_docs(width: int = 640, height: int = 480) -> str:
    """Return the observation table in Markdown, as the documentation shows it."""
    return markdown_table(observation_table(width, height))


def markdown_table(table: Iterable[ObservationItem]) -> str:
    """Return rows of an observation table in Markdown."""
    lines = ["| key | shape | dtype | unit | meaning |", "|---|---|---|---|---|"]
    for item in table:
        shape = "scalar" if isinstance(item.space, spaces.Discrete) else str(item.space.shape)
        lines.append(f"| `{item.key}` | {shape} | {item.space.dtype} | {item.unit or '-'} | {item.meaning} |")
    return "\n".join(lines)
