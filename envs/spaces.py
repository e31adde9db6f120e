"""Spaces of `BinPickEnv`: one table each makes the space and its documentation."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces

from simpick.records import PickOutcome
from simpick.scene.config import MAX_PARTS

OUTCOMES: tuple[PickOutcome, ...] = tuple(PickOutcome)
"""The order in which outcomes are numbered in observations, from 1; 0 means that there was no pick yet."""

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


@dataclass(frozen=True)
class ActionItem:
    """One row of an action table: some elements of the action, each in [-1, 1]."""

    elements: str
    """Their numbers, such as 0-2."""
    meaning: str
    low: str
    """Meaning of -1."""
    high: str
    """Meaning of 1."""
    unit: str


ACTION_TABLE = (
    ActionItem("0-2", "TCP position x, y, z in the world", "lower corner of `workspace`", "upper corner", "m"),
    ActionItem("3-8", "first two columns of the TCP's rotation (6D representation)", "-1", "1", "-"),
    ActionItem("9", "opening of the gripper before it closes", "0", "`Gripper.max_opening_m`", "m"),
)
"""Elements of an action of `BinPickEnv`. An action of zeros abstains."""


def observation_table(width: int, height: int) -> tuple[ObservationItem, ...]:
    """Return the rows for an overhead camera of this size."""
    box = spaces.Box
    return (
        ObservationItem("rgb", "overhead image", "", box(0, 255, (height, width, 3), np.uint8)),
        ObservationItem(
            "depth", "distance along the optical axis; 0: no reading", "m", box(0.0, FAR_M, (height, width), np.float32)
        ),
        ObservationItem(
            "segmentation",
            "1 + instance id of the part seen in each pixel; 0: none",
            "",
            box(0, MAX_PARTS, (height, width), np.uint8),
        ),
        ObservationItem(
            "instance_parts",
            "index into `part_names` per instance id, padded with -1",
            "",
            box(-1, MAX_PARTS - 1, (MAX_PARTS,), np.int16),
        ),
        ObservationItem(
            "camera_matrix", "intrinsics K; pixel centres at +0.5", "px", box(0.0, FAR_PX, (3, 3), np.float64)
        ),
        ObservationItem(
            "T_world_camera", "camera pose, OpenCV axes (+z forward)", "m", box(-FAR_M, FAR_M, (4, 4), np.float64)
        ),
        ObservationItem("remaining", "parts still in the bin", "", spaces.Discrete(MAX_PARTS + 1)),
        ObservationItem(
            "last_outcome",
            "1 + index of the last outcome in `OUTCOMES`; 0: no pick yet",
            "",
            spaces.Discrete(len(OUTCOMES) + 1),
        ),
    )


def observation_space(width: int, height: int) -> spaces.Dict:
    """Return the observation space for an overhead camera of this size."""
    return spaces.Dict({item.key: item.space for item in observation_table(width, height)})


def action_space() -> spaces.Box:
    """Return the action space; see `ACTION_TABLE`."""
    return spaces.Box(-1.0, 1.0, (10,), np.float32)


def outcome_index(outcome: PickOutcome | None) -> int:
    """Return the observation's number of an outcome; 0 for None."""
    return 0 if outcome is None else 1 + OUTCOMES.index(outcome)


def outcome_from_index(index: int) -> PickOutcome | None:
    """Return the outcome behind the observation's number; None for 0."""
    return None if index == 0 else OUTCOMES[index - 1]


def observation_docs(table: Iterable[ObservationItem]) -> str:
    """Return the rows of an observation table in Markdown, as the class docstring of an environment holds it."""
    lines = ["| Key | Observation | Min | Max | Shape and type | Unit |", "|---|---|---|---|---|---|"]
    for item in table:
        low, high = _bounds(item.space)
        shape = f"{item.space.shape} {item.space.dtype}"
        lines.append(f"| `{item.key}` | {item.meaning} | {low:g} | {high:g} | {shape} | {item.unit or '-'} |")
    return "\n".join(lines)


def _bounds(space: spaces.Space) -> tuple[float, float]:
    if isinstance(space, spaces.Box):
        return float(space.low.min()), float(space.high.max())
    return (0.0, float(space.n) - 1) if isinstance(space, spaces.Discrete) else (0.0, 1.0)


def action_docs(table: Iterable[ActionItem]) -> str:
    """Return the rows of an action table in Markdown, as the class docstring of an environment holds it."""
    lines = ["| Num | Action | At -1 | At 1 | Unit |", "|---|---|---|---|---|"]
    lines += [f"| {item.elements} | {item.meaning} | {item.low} | {item.high} | {item.unit} |" for item in table]
    return "\n".join(lines)
