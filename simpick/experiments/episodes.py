"""Running episodes: an environment, a policy and a recorder, from a configuration to an `EpisodeResult`."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from simpick.assets import library_part_names
from simpick.assets.part import Part
from simpick.core_time import measured_core_time
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.observations import frame_from_observation
from simpick.experiments.config import CellConfig, RunConfig
from simpick.experiments.perceptions import make_perception, make_refiner
from simpick.experiments.result_store import EpisodeResult
from simpick.geometry import invert
from simpick.metrics.models import EvaluationModel
from simpick.metrics.pose_errors import mssd, pose_error
from simpick.policies import PickPolicy
from simpick.policies.pick_policy import Decision
from simpick.recording.base import NullRecorder, Recorder
from simpick.records import CameraFrame, InstanceTruth, PickOutcome, PickRecord, PoseEstimate
from simpick.scene import BinConfig, SceneConfig


def make_scene_config(config: CellConfig) -> SceneConfig:
    """Return the scene that a configuration asks for.

    Raises:
        ConfigError, UnknownNameError: a setting is out of range, or a name does not exist.
    """
    length_m, width_m, depth_m = (side / 1000 for side in config.bin_mm)
    return SceneConfig(
        parts=config.parts or tuple(library_part_names()),
        count=config.count,
        robot=config.robot,
        gripper=config.gripper,
        bin=BinConfig(length_m, width_m, depth_m),
        randomization=config.randomization,
    )


def make_env(config: CellConfig) -> BinPickEnv:
    """Return the environment that a configuration asks for."""
    return BinPickEnv(scene_config=make_scene_config(config), max_consecutive_failures=config.max_consecutive_failures)


def validate(config: RunConfig) -> None:
    """Check every name, part and setting of a run, before anything is simulated or written.

    Raises:
        SimpickError: something is wrong; the message states what, and what to do.
    """
    env = make_env(config)
    make_perception(config, env, np.random.default_rng(0))
    env.close()


def make_policy(config: RunConfig, env: BinPickEnv, seed: int) -> PickPolicy:
    """Return the policy that a configuration asks for; what is random in its perception follows from `seed`."""
    perception = make_perception(config, env, np.random.default_rng([seed, 1]))
    refiner = make_refiner(config, env) if config.look_closer else None
    return PickPolicy(perception, env.parts, env.scene_config, look_closer=refiner)


def run_configured_episode(
    config: RunConfig,
    episode: int,
    *,
    env: BinPickEnv | None = None,
    recorder: Recorder | None = None,
    on_pick: Callable[[PickRecord], None] | None = None,
) -> EpisodeResult:
    """Run one episode of `config` and return what happened; closes an environment that it made itself.

    Everything but the wall-clock timings follows from the configuration and the episode's number.
    """
    own_env = env is None
    env = make_env(config) if env is None else env
    seed = config.seed + episode
    try:
        return run_episode(
            env,
            make_policy(config, env, seed),
            seed,
            episode=episode,
            mode=config.mode,
            settings=config.to_json(),
            recorder=recorder,
            on_pick=on_pick,
        )
    finally:
        if own_env:
            env.close()


def run_recorded_episode(
    config: RunConfig, episode: int, folder: Path | None, *, on_pick: Callable[[PickRecord], None] | None = None
) -> EpisodeResult:
    """Run one episode of `config`, recorded into `folder` unless that is None."""
    if folder is None:
        return run_configured_episode(config, episode, on_pick=on_pick)
    # Only here: rerun takes time to import.
    from simpick.recording import RerunRecorder

    with RerunRecorder(recording_file(folder, config, episode), overwrite=True) as recorder:
        return run_configured_episode(config, episode, recorder=recorder, on_pick=on_pick)


def run_episode(
    env: BinPickEnv,
    policy: PickPolicy,
    seed: int = 0,
    *,
    episode: int = 0,
    mode: str | None = None,
    settings: Mapping[str, Any] | None = None,
    recorder: Recorder | None = None,
    on_pick: Callable[[PickRecord], None] | None = None,
) -> EpisodeResult:
    """Let `policy` pick the bin of this seed until the episode ends, and return every pick.

    Each `PickRecord` holds outcome, cause, the pose's error and timings; `on_pick` receives it as soon as it is known.
    `episode`, `mode` (by default the perception's name) and `settings` name the episode in its result and recording.
    A policy with a refiner corrects each grasp by a second image, from the wrist camera.
    """
    recorder = NullRecorder() if recorder is None else recorder
    mode = policy.perception.name if mode is None else mode
    start = time.perf_counter()
    policy.reset()
    observation, info = env.reset(seed=seed)
    timings_s = {"reset": time.perf_counter() - start}
    recorder.start_episode(
        episode_id=episode_id(mode, env.scene_config.gripper, seed),
        config={**(settings or {}), "episode": episode},
        model=env.scene.model,
        data=env.scene.data,
        parts=env.parts,
    )
    env.on_tick = lambda scene: recorder.tick(scene.data)
    env.on_stage = recorder.stage
    if policy.looks_closer:
        env.on_look = lambda frame, T_world_tcp: _look(policy, recorder, frame, T_world_tcp)
    picks: list[PickRecord] = []
    ended = "cleared" if info["is_success"] else ""
    try:
        with measured_core_time() as core_time:
            while not ended:
                pick, observation, ended = _pick(env, policy, observation, len(picks), recorder)
                picks.append(pick)
                if on_pick is not None:
                    on_pick(pick)
        timings_s |= {"threads_run": core_time().run_s, "threads_wait": core_time().wait_s}
    finally:
        env.on_tick = env.on_stage = env.on_look = None
    instances = tuple(instance.part.name for instance in env.scene.instances)
    timings_s["wall"] = time.perf_counter() - start
    result = EpisodeResult(episode, seed, instances, tuple(picks), ended, timings_s, mode)
    recorder.end_episode(result.summary())
    return result


def _pick(
    env: BinPickEnv, policy: PickPolicy, observation: dict[str, Any], number: int, recorder: Recorder
) -> tuple[PickRecord, dict[str, Any], str]:
    """Make one pick; return its record, the next observation, and why the episode ended, if it did."""
    truth, render_s = env.truth(), env.timings_s["render"]
    recorder.start_pick(number)
    frame = frame_from_observation(observation)
    action = policy.act(observation)
    decision = policy.decision
    recorder.frame("overhead", frame)
    recorder.detections("overhead", decision.percept.detections)
    recorder.estimates(frame.T_world_camera, decision.percept.estimates)
    recorder.truth(truth)
    if decision.grasp is not None:
        recorder.grasp(decision.grasp.T_world_tcp)
    observation, _, _, _, info = env.step(action)
    pick = complete_record(info["pick"], policy, truth, frame.T_world_camera, env)
    waited_s = {"render": render_s, **decision.percept.timings_s, "plan": decision.plan_s}
    simulated_s = {"look": env.timings_s["look"], "simulate": env.timings_s["simulate"]}
    pick = dataclasses.replace(pick, timings_s={**waited_s, **simulated_s})
    recorder.end_pick(pick)
    return pick, observation, info["ended"]


def _look(policy: PickPolicy, recorder: Recorder, frame: CameraFrame, T_world_tcp: np.ndarray) -> np.ndarray | None:
    """Correct a grasp by the wrist camera's image, and record both."""
    corrected = policy.look(frame, T_world_tcp)
    view = policy.closer_view
    recorder.frame("wrist", frame)
    recorder.detections("wrist", [] if view is None or view.detection is None else [view.detection])
    if view is not None:
        recorder.estimates(frame.T_world_camera, [view])
    if corrected is not None:
        recorder.grasp(corrected)
    return corrected


def complete_record(
    pick: PickRecord,
    policy: PickPolicy,
    truth: tuple[InstanceTruth, ...],
    T_world_camera: np.ndarray,
    env: BinPickEnv,
) -> PickRecord:
    """Return the environment's record with what only the policy knows: target, pose error, why it abstained.

    The error is that of the pose that was picked by: the one from the wrist, where a closer look found the part.
    """
    decision, T_world_target = policy.decision, policy.T_world_target
    if decision.abstained is not None:
        return dataclasses.replace(pick, outcome=decision.abstained, cause=cause_of_abstention(decision))
    target = decision.target
    assert target is not None and target.detection is not None and T_world_target is not None
    T_camera_world = invert(T_world_camera)
    model = _evaluation_model(next(p for p in env.parts if p.name == target.part))
    true = _true_instance(target, T_world_target, truth, model)
    error = None
    if true is not None:
        error = pose_error(T_camera_world @ T_world_target, T_camera_world @ true.T_world_part, model)
    # An instance that the detection names stays named, even if it has left the bin.
    instance = target.detection.instance if true is None else true.instance
    return dataclasses.replace(pick, target_part=target.part, target_instance=instance, pose_error=error)


def _true_instance(
    target: PoseEstimate, T_world_target: np.ndarray, truth: tuple[InstanceTruth, ...], model: EvaluationModel
) -> InstanceTruth | None:
    """Return the instance that a pose is scored against: the detection's, else the part's nearest by MSSD."""
    if target.detection is not None and target.detection.instance is not None:
        return next((t for t in truth if t.instance == target.detection.instance), None)
    own = [t for t in truth if t.part == target.part]
    if not own:
        return None
    return own[int(mssd(T_world_target, np.stack([t.T_world_part for t in own]), model).argmin())]


@lru_cache(maxsize=64)
def _evaluation_model(part: Part) -> EvaluationModel:
    """Return a part's evaluation model; its hull, search tree and symmetries are computed once, not per pick."""
    return EvaluationModel.of(part)


def cause_of_abstention(decision: Decision) -> str:
    """Return in words why a policy chose no grasp: which step left nothing, and for the planner, which filters."""
    percept = decision.percept
    if decision.abstained is PickOutcome.NOTHING_DETECTED:
        shown_px = 0 if percept.foreground is None else int(percept.foreground.sum())
        shown = f", though {shown_px} px show parts" if shown_px else ""
        needed = f"; it needs {percept.needed_px} px of one" if percept.needed_px is not None else ""
        return f"look: the detector found no part{shown}{needed}"
    if not percept.estimates:
        return f"estimate: none of the {len(percept.detections)} detections got a pose"
    reasons = ", ".join(f"{count} {why.value}" for why, count in decision.rejected.most_common() if count)
    return f"plan: no grasp is left on the {len(percept.estimates)} estimated parts: {reasons or 'they have none'}"


def episode_id(mode: str, gripper: str, seed: int) -> str:
    """Return the name of an episode and of its recording."""
    return f"{mode}_{gripper}_seed{seed:04d}"


def recording_file(folder: Path, config: RunConfig, episode: int) -> Path:
    """Return the file of an episode's recording."""
    return folder / f"{episode_id(config.mode, config.gripper, config.seed + episode)}.rrd"
