"""`RerunRecorder`: one episode as one rerun recording, equal for equal seeds."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.errors import ConfigError
from simpick.recording.base import Recorder
from simpick.recording.blueprint import OUTCOME_COLOURS, default_blueprint, log_styles
from simpick.recording.column_buffer import Instant
from simpick.recording.contact_force import ContactForce
from simpick.recording.legend import LEGEND, LEGEND_PATH
from simpick.recording.mujoco_logger import DEFAULT_GROUPS, MujocoLogger
from simpick.recording.perception_layers import LayerPaths, PerceptionLayers
from simpick.recording.pick_columns import OUTCOME_PATH, log_pick_record, log_properties
from simpick.recording.recording_file import RecordingFile
from simpick.records import CameraFrame, Detection, InstanceTruth, PickOutcome, PickRecord, PoseEstimate

_ROOT = "/world"
_VIEWER_FOV_RAD = np.radians(55)
_TEXT_COLOUR = 0xB0BEC5FF
_FLUSH_TICKS = 250
"""Ticks after which motion is sent, also in the midst of a pick, so that memory stays small."""


class RerunRecorder(Recorder):
    """Writes an episode to an ``.rrd`` file; see `simpick.recording.base` for the order of events.

    By default nothing that depends on the wall clock is written, so that the recordings of two runs with the same
    seed are equal under ``rerun rrd compare --unordered``; ``record_timings=True`` adds the latencies of each pick
    (``/latency/<stage>``, seconds) and breaks that equality.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        overwrite: bool = False,
        record_timings: bool = False,
        rate_hz: float = 25.0,
        jpeg_quality: int = 85,
        groups: Sequence[int] = DEFAULT_GROUPS,
        gripper_prefix: str = "gripper/",
        serve_port: int | None = None,
    ) -> None:
        """Reserve the file.

        `rate_hz` is how often, in simulated time, motion is noted; `groups` are the geom groups drawn;
        `gripper_prefix` begins the names of the bodies whose contact forces are plotted; `serve_port` also serves
        the recording while it grows, on 127.0.0.1 only (``rerun rerun+http://127.0.0.1:PORT/proxy``).

        Raises `ConfigError` for a value out of range and `OutputError` if the file cannot be written.
        """
        if not 0 < rate_hz <= 1000:
            raise ConfigError(f"rate_hz must be in (0, 1000], got {rate_hz}; 25 is smooth to the eye")
        if not 1 <= jpeg_quality <= 100:
            raise ConfigError(f"jpeg_quality must be in 1..100, got {jpeg_quality}; 85 is hard to distinguish from 100")
        self._file = RecordingFile(path, overwrite=overwrite)
        self._record_timings, self._period_s, self._jpeg_quality = record_timings, 1.0 / rate_hz, jpeg_quality
        self._groups, self._gripper_prefix, self._serve_port = groups, gripper_prefix, serve_port
        self._episode: _Episode | None = None
        self._now = Instant(0.0, 0)
        self._next_tick_s = -np.inf
        self._ticks = self._picks = self._successes = 0
        self._pick_start = self._now

    def start_episode(
        self,
        *,
        episode_id: str,
        config: Mapping[str, object],
        model: mujoco.MjModel,
        data: mujoco.MjData,
        parts: Sequence[Part],
    ) -> None:
        """Open the recording under the id `episode_id`; log geometry, layout and configuration."""
        if self._episode is not None:
            raise ConfigError("a RerunRecorder holds one episode; make another one for the next")
        stream = self._file.open(episode_id, serve_port=self._serve_port)
        logger = MujocoLogger(stream, model, root=_ROOT, groups=self._groups)
        paths = LayerPaths(
            logger.camera_paths,
            detections=logger.detections_path,
            estimates=logger.estimates_path,
            truth=logger.truth_path,
            grasp=logger.grasp_path,
            moving_cameras=logger.moving_cameras,
        )
        layers = PerceptionLayers(stream, paths, parts, self._jpeg_quality)
        self._episode = _Episode(stream, logger, layers, ContactForce(model, self._gripper_prefix), _eye(model, data))
        stream.send_recording_name(episode_id)
        log_properties(stream, "config", config)
        log_styles(stream)
        stream.log(LEGEND_PATH, rr.TextDocument(LEGEND, media_type="text/markdown"), static=True, strict=True)
        layers.log_mask_colours(_ROOT)
        logger.log_static(data)
        self._next_tick_s = float(data.time)
        self.tick(data)
        self._flush()

    def tick(self, data: mujoco.MjData) -> None:
        """Note poses and contact force if the next sampling time has come, else return at once."""
        if data.time < self._next_tick_s - 1e-9:
            return
        episode = self._running("tick")
        self._next_tick_s = float(data.time) + self._period_s
        self._set_time(Instant(float(data.time), self._now.pick))
        episode.logger.tick(data, self._now)
        if episode.force.exists:
            newtons = episode.force.newtons(data)
            episode.logger.buffer.add_scalar(self._now, "/gripper/contact_force_n", newtons)
        self._ticks += 1
        if self._ticks % _FLUSH_TICKS == 0:
            episode.logger.flush()

    def start_pick(self, pick: int) -> None:
        """Begin a pick: later events have this number on the timeline ``pick``.

        Raises `OutputError` where the disk is full; what was recorded before can still be closed.
        """
        self._running("start_pick")
        self._file.require_room()
        self._set_time(Instant(self._now.sim_time_s, pick))
        self._pick_start = self._now
        self._log_state(OUTCOME_PATH, "")
        self._log_text(f"pick {pick}", "INFO")

    def frame(self, camera: str, frame: CameraFrame) -> None:
        """Log the image as JPEG and its depth, with the camera that took them."""
        episode = self._running("frame")
        episode.layers.frame(camera, frame)
        episode.logger.log_camera(camera, frame.camera, frame.T_world_camera, self._now)

    def detections(self, camera: str, detections: Sequence[Detection]) -> None:
        """Log boxes and masks over the camera's image."""
        self._running("detections").layers.detections(camera, detections)

    def estimates(self, T_world_camera: Float[np.ndarray, "4 4"], estimates: Sequence[PoseEstimate]) -> None:
        """Show the estimates as translucent meshes below ``/world/estimates/<mode>``."""
        self._running("estimates").layers.estimates(T_world_camera, estimates)

    def truth(self, truth: Sequence[InstanceTruth]) -> None:
        """Show the edges of the parts in the bin at ``/world/truth``."""
        self._running("truth").layers.truth(truth)

    def grasp(self, T_world_tcp: Float[np.ndarray, "4 4"]) -> None:
        """Show the chosen gripper pose as axes at ``/world/grasp``."""
        self._running("grasp").layers.grasp(T_world_tcp)

    def stage(self, name: str, text: str = "") -> None:
        """Log a stage on the timeline of states and in the text log."""
        self._running("stage")
        self._log_state("/pick/stage", name)
        self._log_text(f"{name}: {text}" if text else name, "DEBUG")

    def scalar(self, name: str, value: float) -> None:
        """Log a number at ``/user/<name>``."""
        path = f"/user/{rr.escape_entity_path_part(name)}"
        self._running("scalar").stream.log(path, rr.Scalars(float(value)), strict=True)

    def end_pick(self, record: PickRecord) -> None:
        """Log the record: outcome, cause, pose errors, force, times."""
        episode = self._running("end_pick")
        if self._now.pick != record.pick:
            raise ConfigError(f"end_pick got the record of pick {record.pick} in pick {self._now.pick}; start it first")
        log_pick_record(episode.stream, record, timings=self._record_timings)
        self._picks += 1
        self._successes += record.outcome is PickOutcome.SUCCESS
        episode.stream.log("/score/success_rate", rr.Scalars(self._successes / self._picks), strict=True)
        level = "INFO" if record.outcome is PickOutcome.SUCCESS else "WARN"
        target = f" ({record.target_part})" if record.target_part else ""
        cause = f": {record.cause}" if record.cause else ""
        self._log_text(f"{record.outcome}{target}{cause}", level, OUTCOME_COLOURS[record.outcome])
        self._log_state("/pick/stage", "")
        # The outcome is logged at the pick's beginning, so that its band covers the pick on the timeline of states.
        end = self._now
        self._set_time(self._pick_start)
        self._log_state(OUTCOME_PATH, record.outcome)
        self._set_time(end)
        self._flush()

    def end_episode(self, summary: Mapping[str, object]) -> None:
        """Log the episode's figures as the recording property ``summary``."""
        episode = self._running("end_episode")
        log_properties(episode.stream, "summary", summary)
        self._flush()

    def close(self) -> None:
        """Write what is pending and close the file; a second call does nothing."""
        episode, self._episode = self._episode, None
        if episode is not None:
            episode.logger.flush()
            # Only now is it known which cameras took images and which modes made estimates.
            cameras, logger = episode.layers.recorded_cameras, episode.logger
            used = {camera.path for camera in cameras}
            layout = default_blueprint(
                _ROOT,
                cameras,
                hidden=[path for path in logger.camera_paths.values() if path not in used],
                overlays=episode.layers.edge_paths,
                eye=episode.eye,
                near_eye=episode.layers.near_eye,
                latencies=self._record_timings,
            )
            episode.stream.send_blueprint(layout)
        self._file.close()

    def _running(self, event: str) -> _Episode:
        if self._episode is None:
            raise ConfigError(f"{event} must come between start_episode and close")
        return self._episode

    def _set_time(self, instant: Instant) -> None:
        stream = self._running("time").stream
        self._now = instant
        stream.set_time("sim_time", duration=np.timedelta64(instant.sim_time_ns, "ns"))
        stream.set_time("pick", sequence=instant.pick or 0)

    def _log_state(self, path: str, state: str) -> None:
        """Enter a state on the timeline of states; an empty one leaves a gap."""
        self._running("state").stream.log(path, rr.StateChange(state=str(state)), strict=True)

    def _log_text(self, text: str, level: str, colour: int = _TEXT_COLOUR) -> None:
        # A line without a colour would take that of the line before.
        self._running("log").stream.log("/log", rr.TextLog(text, level=level, color=colour), strict=True)

    def _flush(self) -> None:
        episode = self._running("flush")
        episode.logger.flush()
        # Chunks end here whether or not one waits for them to be written.
        episode.stream.flush(timeout_sec=0.0)


@dataclass(frozen=True)
class _Episode:
    """What exists only between start and close."""

    stream: rr.RecordingStream
    logger: MujocoLogger
    layers: PerceptionLayers
    force: ContactForce
    eye: tuple[list[float], list[float]]


def _eye(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[list[float], list[float]]:
    """Return where the viewer stands and looks: as the model's camera "overview", or from the front right above."""
    target = np.asarray(model.stat.center, float)
    eye = target + 1.1 * float(model.stat.extent) * np.array([1.0, -0.8, 0.7])
    camera = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, "overview")
    if camera >= 0:
        place, forward = data.cam_xpos[camera], -data.cam_xmat[camera].reshape(3, 3)[:, 2]
        distance = np.linalg.norm(target - place)
        target = place + forward * distance
        # The viewer's field of view is fixed: stand where the same height fills it.
        fov = np.radians(float(model.cam_fovy[camera]))
        eye = target - forward * distance * np.tan(fov / 2) / np.tan(_VIEWER_FOV_RAD / 2)
    return [float(value) for value in eye], [float(value) for value in target]
