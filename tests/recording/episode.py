"""A small episode, the same in every process; run as a script it records one: ``episode.py OUT.rrd [event]``."""

import os
import signal
import sys

import mujoco
import numpy as np
import trimesh

from simpick.assets.part import Part
from simpick.geometry.pinhole import Pinhole
from simpick.recording import Recorder, RerunRecorder
from simpick.records import (
    CameraFrame,
    Detection,
    InstanceTruth,
    PickOutcome,
    PickRecord,
    PickResult,
    PoseError,
    PoseEstimate,
)

XML = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 .1"/>
    <camera name="overhead" pos="0 0 1.2" fovy="45" resolution="64 48"/>
    <camera name="unused" pos="1 0 1.2"/>
    <body name="gripper/tip" pos="0 0 .24">
      <joint name="drop" type="slide" axis="0 0 1"/>
      <geom name="gripper/pad" type="box" size=".05 .05 .02"/>
      <camera name="wrist"/>
    </body>
    <body name="part_00" pos="0 0 .06"><freejoint/><geom name="part_00/visual" type="box" size=".06 .06 .06"/></body>
    <body name="part_01" pos=".4 0 .3"><freejoint/><geom type="sphere" size=".05"/></body>
  </worldbody>
</mujoco>
"""
CAMERA = Pinhole.from_fovy(64, 48, 45.0)
T_WORLD_CAMERA = np.array([[1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 1.2], [0, 0, 0, 1]])
CONFIG = {"seed": 7, "gripper": "jaw", "noise_mm": 0.5, "parts": ("block", "cube"), "bin": {"depth_m": 0.12}}


def parts() -> list[Part]:
    return [Part(name, mesh, (mesh,)) for name, mesh in (("block", trimesh.creation.box((0.08, 0.1, 0.12))),)]


def records() -> list[PickRecord]:
    error = PoseError(rotation_deg=1 / 3, translation_mm=2.25, lateral_mm=1.0, depth_mm=-2.0, mssd_mm=3.1)
    delivered = PickResult(PickOutcome.SUCCESS, "", ("approach", "lift"), 5.4, 12.5, delivered=(0,), gripped=(0,))
    unseen = PickResult(PickOutcome.NOTHING_DETECTED, "no part was seen")
    pushed = PickResult(PickOutcome.EJECTED, "part_01 left the bin", ("approach",), 3.0, ejected=(1,))
    target = {"target_part": "block", "pose_error": error}
    return [
        PickRecord(**vars(delivered), pick=0, remaining=1, target_instance=0, **target),
        PickRecord(**vars(unseen), pick=1, remaining=1),
        PickRecord(**vars(pushed), pick=2, remaining=0, target_instance=1, **target),
    ]


def record_episode(recorder: Recorder, timings_s: dict[str, float] | None = None) -> list[PickRecord]:
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rng = np.random.default_rng(0)
    recorder.start_episode(episode_id="test-7", config=CONFIG, model=model, data=data, parts=parts())
    written = []
    for k, record in enumerate(records()):
        recorder.start_pick(k)
        rgb = rng.integers(0, 255, (48, 64, 3), dtype=np.uint8)
        frame = CameraFrame(rgb, CAMERA, T_WORLD_CAMERA, np.full((48, 64), 1.0, np.float32))
        recorder.frame("overhead", frame)
        mask = np.zeros((48, 64), bool)
        mask[10:20, 10:30] = True
        detection = Detection("block", np.array([10.0, 10, 30, 20]), mask, 0.9)
        recorder.detections("overhead", [detection] * (2 - k))
        T_camera_part = np.linalg.inv(T_WORLD_CAMERA) @ np.diag([1.0, 1, 1, 1])
        recorder.estimates(T_WORLD_CAMERA, [PoseEstimate("block", T_camera_part, 0.9, "oracle", 0.01)] * (2 - k))
        recorder.truth([InstanceTruth(0, "block", np.eye(4), True), InstanceTruth(1, "block", np.eye(4), False)])
        recorder.grasp(np.eye(4))
        for stage in record.stages:
            recorder.stage(stage, "on the way")
            for _ in range(100):
                mujoco.mj_step(model, data)
                recorder.tick(data)
        recorder.scalar("reward", float(k))
        record.timings_s.update(timings_s or {})
        recorder.end_pick(record)
        written.append(record)
    recorder.end_episode({"success_rate": 1 / 3, "modes": ["oracle"]})
    return written


def main() -> None:
    event = sys.argv[2] if len(sys.argv) > 2 else "close"
    recorder = RerunRecorder(sys.argv[1])
    record_episode(recorder)
    if event == "exit":
        sys.exit(0)
    if event == "raise":
        raise RuntimeError("the run broke")
    if event == "terminate":
        os.kill(os.getpid(), signal.SIGTERM)
    if event == "interrupt":
        # A shell starts background jobs with interrupts ignored, and children inherit that: undo it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        os.kill(os.getpid(), signal.SIGINT)
    recorder.close()


if __name__ == "__main__":
    main()
