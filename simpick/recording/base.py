"""The `Recorder` protocol, and `NullRecorder` for runs that record nothing. Neither needs rerun.

An episode is a sequence of events::

    with recorder:
        recorder.start_episode(episode_id=..., config=..., model=..., data=..., parts=...)
        for each pick:
            recorder.start_pick(k)
            recorder.frame("overhead", frame)
            recorder.detections("overhead", detections)
            recorder.estimates(frame.T_world_camera, estimates)
            recorder.truth(truth)
            recorder.grasp(T_world_tcp)
            recorder.stage("approach")             # whenever the robot enters a stage
            recorder.tick(data)                    # after every physics step; the recorder thins them out
            recorder.end_pick(record)
        recorder.end_episode({"success_rate": ...})

Every event between `start_episode` and `end_episode` belongs to the simulated time of the latest `tick` that the
recorder has noted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.records import CameraFrame, Detection, InstanceTruth, PickRecord, PoseEstimate


@runtime_checkable
class Recorder(Protocol):
    """Listens to one episode. All methods return quickly; a context manager closes the recording on every exit."""

    def start_episode(
        self,
        *,
        episode_id: str,
        config: Mapping[str, object],
        model: mujoco.MjModel,
        data: mujoco.MjData,
        parts: Sequence[Part],
    ) -> None:
        """Begin: `config` is what repeats the episode, `parts` are the kinds that estimates may name."""

    def tick(self, data: mujoco.MjData) -> None:
        """Note the state after a physics step; most calls return at once."""

    def start_pick(self, pick: int) -> None:
        """Begin pick number `pick`."""

    def frame(self, camera: str, frame: CameraFrame) -> None:
        """Note the image that perception was given by the MuJoCo camera of this name."""

    def detections(self, camera: str, detections: Sequence[Detection]) -> None:
        """Note what was detected in the latest image of this camera."""

    def estimates(self, T_world_camera: Float[np.ndarray, "4 4"], estimates: Sequence[PoseEstimate]) -> None:
        """Note the poses that were estimated; they replace earlier ones of the same mode, none replace all."""

    def truth(self, truth: Sequence[InstanceTruth]) -> None:
        """Note the true poses of the parts in the bin at this moment; perception does not get them."""

    def grasp(self, T_world_tcp: Float[np.ndarray, "4 4"]) -> None:
        """Note the gripper pose that was chosen."""

    def stage(self, name: str, text: str = "") -> None:
        """Note that the robot entered a stage (``approach``, ``lift``, ...); `text` adds a note for the viewer."""

    def scalar(self, name: str, value: float) -> None:
        """Note a number of the caller's own, plotted as ``/user/<name>``."""

    def end_pick(self, record: PickRecord) -> None:
        """End the pick with its record."""

    def end_episode(self, summary: Mapping[str, object]) -> None:
        """End the episode; `summary` holds the figures of the whole."""

    def close(self) -> None:
        """Finish the recording; a second call does nothing."""

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class NullRecorder(Recorder):
    """Records nothing."""
