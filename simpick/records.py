"""Records that cross rooms: frozen, small, and without behaviour. Frames and units as in `simpick.geometry`."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from simpick.geometry.pinhole import Pinhole


@dataclass(frozen=True, eq=False)
class CameraFrame:
    """One image with the camera that took it; images never travel without it."""

    rgb: UInt8[np.ndarray, "height width 3"]
    camera: Pinhole
    T_world_camera: Float[np.ndarray, "4 4"]
    depth_m: Float[np.ndarray, "height width"] | None = None
    """Distance along the optical axis in metres, float32; 0 means no reading."""
    instances: Int[np.ndarray, "height width"] | None = None
    """Instance id of the part seen in each pixel, int32; -1 where no part is seen. Simulated frames only."""


@dataclass(frozen=True, eq=False)
class Detection:
    """One part instance in one image."""

    part: str
    box_xyxy_px: Float[np.ndarray, "4"]
    mask: Bool[np.ndarray, "height width"] | None
    """Visible (modal) pixels at the image's size."""
    score: float
    instance: int | None = None
    """Simulator's id of the instance this came from: for the oracle and for evaluation only, None elsewhere."""


@dataclass(frozen=True, eq=False)
class PoseHypothesis:
    """One candidate pose; a higher score is more certain."""

    T_camera_part: Float[np.ndarray, "4 4"]
    score: float


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The estimator's answer to one detection."""

    part: str
    T_camera_part: Float[np.ndarray, "4 4"]
    """Of the centred part frame; for the CAD file's: ``T_camera_part @ invert(Part.T_cad_part)``."""
    score: float
    mode: str
    """Name of the estimator, such as ``oracle``, ``retrieval`` or ``fine``."""
    elapsed_s: float
    """Wall-clock time that this estimate cost: a batch's time divided by its detections."""
    hypotheses: tuple[PoseHypothesis, ...] = ()
    """Best first; empty if the estimator makes only one."""
    detection: Detection | None = None


@dataclass(frozen=True, eq=False)
class Grasp:
    """A placement of a gripper on a part."""

    T_part_tcp: Float[np.ndarray, "4 4"]
    width_m: float
    """Extent of the part between a jaw's pads; 0 for grippers without an opening."""
    quality: float
    """In [0, 1]; higher is more robust."""


class PickOutcome(StrEnum):
    """How one pick ended."""

    SUCCESS = "success"
    """One part was delivered into the chute."""
    NOTHING_DETECTED = "nothing_detected"
    """Perception returned no part."""
    NO_GRASP = "no_grasp"
    """Parts were seen, but every grasp was filtered out."""
    UNREACHABLE = "unreachable"
    """The motion planner found no motion to the commanded TCP pose."""
    COLLISION = "collision"
    """Arm or gripper hit the bin, or was stopped by parts on the way."""
    MISSED = "missed"
    """The gripper closed on nothing."""
    SLIPPED = "slipped"
    """A part was gripped and lost while lifting, before it had left the bin."""
    DROPPED = "dropped"
    """A part left the bin in the gripper and was lost on the way to the chute."""
    DOUBLE_PICK = "double_pick"
    """More than one part was carried away at once."""
    EJECTED = "ejected"
    """A part left the bin without being carried: pushed out, knocked into the chute, or stuck to the gripper."""
    SIMULATION_FAULT = "simulation_fault"
    """The physics diverged (NaN); the pick is no evidence about perception."""


@dataclass(frozen=True, eq=False)
class InstanceTruth:
    """The true state of one part in the scene."""

    instance: int
    part: str
    T_world_part: Float[np.ndarray, "4 4"]
    in_bin: bool


@dataclass(frozen=True)
class PoseError:
    """A pose estimate against the truth, over the part's symmetries."""

    rotation_deg: float
    translation_mm: float
    lateral_mm: float
    """Across the camera's line of sight to the part."""
    depth_mm: float
    """Along the optical axis, signed: positive is too far."""
    mssd_mm: float


@dataclass(frozen=True)
class PickResult:
    """What happened during one pick, as the simulator knows it."""

    outcome: PickOutcome
    cause: str
    """Description of the cause: the stage and what was noticed there."""
    stages: tuple[str, ...] = ()
    """Stages started, in order."""
    motion_s: float = 0.0
    """Simulated time from leaving home to being back; 0 where the arm never left."""
    peak_force_n: float = 0.0
    """Largest contact force on one of the gripper's contact geoms, such as a jaw's pad."""
    delivered: tuple[int, ...] = ()
    """Instances that reached the chute; they have been removed from the scene."""
    ejected: tuple[int, ...] = ()
    """Instances that left the bin and did not reach the chute."""
    gripped: tuple[int, ...] = ()
    """Instances that the gripper held after closing."""


@dataclass(frozen=True, kw_only=True)
class PickRecord(PickResult):
    """One pick of an episode, as it is stored in ``results.jsonl``."""

    pick: int
    """Number of the pick within its episode, from 0."""
    remaining: int
    """Parts left in the bin afterwards."""
    target_part: str | None = None
    """Name of the part that was to be picked; None without a target, as is the instance."""
    target_instance: int | None = None
    pose_error: PoseError | None = None
    """Error of the estimate that the grasp was planned on; None without one."""
    timings_s: dict[str, float] = field(default_factory=dict)
    """Wall-clock seconds per stage (render, detect, estimate, plan, simulate); excluded from equality checks."""
