"""Episodes on a Ray cluster: one actor per core, which keeps its estimators onboarded from job to job."""

from __future__ import annotations

import os
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from simpick.caching import atomic_write_bytes
from simpick.errors import SimpickError
from simpick.experiments.config import RunConfig
from simpick.experiments.episodes import recording_file, run_recorded_episode
from simpick.experiments.result_store import EpisodeResult

RETRIES = 2
"""How many times an episode is repeated after the machine or process that ran it was lost."""


class EpisodeActor:
    """Runs episodes in a process of the cluster."""

    def run(self, config: RunConfig, episode: int, record: bool) -> tuple[EpisodeResult, bytes | None]:
        """Return an episode's result and its recording, which may be made on a machine with other disks."""
        if not record:
            return run_recorded_episode(config, episode, None), None
        with tempfile.TemporaryDirectory() as folder:
            result = run_recorded_episode(config, episode, Path(folder))
            return result, recording_file(Path(folder), config, episode).read_bytes()


def results_from_ray(
    jobs: Sequence[tuple[RunConfig, int]], folder: Path | None, address: str
) -> Iterator[EpisodeResult]:
    """Run episodes on the cluster at `address` and yield their results as they end.

    ``local`` starts a cluster on this machine, ``auto`` takes the one that this machine belongs to. simpick and mesh
    files must be installed at the same paths on every machine. Recordings are written to `folder`.

    Raises:
        SimpickError: Ray is not installed, no cluster answers, or an episode was lost too many times.
    """
    ray = _connect(address)
    try:
        cores = int(ray.cluster_resources().get("CPU", 1))
        actor_class = ray.remote(num_cpus=1, max_restarts=RETRIES, max_task_retries=RETRIES)(EpisodeActor)
        idle = [actor_class.remote() for _ in range(min(cores, len(jobs)))]
        waiting, running = deque((job, 0) for job in jobs), {}
        while waiting or running:
            while idle and waiting:
                actor, (job, losses) = idle.pop(), waiting.popleft()
                running[actor.run.remote(*job, folder is not None)] = actor, job, losses
            (done,), _ = ray.wait(list(running), num_returns=1)
            actor, (config, episode), losses = running.pop(done)
            try:
                result = _received(ray, done, config, episode, folder)
            except ray.exceptions.RayError as error:
                if losses == RETRIES:
                    raise SimpickError(
                        f"the Ray cluster lost episode {episode} of {config.mode} {RETRIES + 1} times "
                        f"({type(error).__name__}). What was finished is kept: run the same command again to resume"
                    ) from error
                # Ray restarts a process; one whose machine is gone is left out, and replaced where it was the last.
                waiting.append(((config, episode), losses + 1))
                idle += [] if idle or running else [actor_class.remote()]
                continue
            idle.append(actor)
            yield result
    finally:
        ray.shutdown()


def _connect(address: str) -> Any:
    """Return the `ray` module, connected."""
    # Ray sends usage statistics to its developers by default, and a run of simpick needs no network of its own.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        ray = import_module("ray")
    except ImportError as error:
        raise SimpickError(
            "--ray needs the package ray, which is not installed: pip install 'simpick[cluster]'"
        ) from error
    options = {"include_dashboard": False} if address == "local" else {}
    try:
        ray.init(address=address, log_to_driver=False, **options)
    except (ConnectionError, ValueError, RuntimeError) as error:
        first_line = str(error).strip().splitlines()[0]
        raise SimpickError(
            f"no Ray cluster answers at {address!r} ({first_line}). Start one with: ray start --head; "
            "or use --ray local for this machine alone"
        ) from error
    return ray


def _received(ray: Any, done: Any, config: RunConfig, episode: int, folder: Path | None) -> EpisodeResult:
    try:
        result, recording = ray.get(done)
    except ray.exceptions.RayTaskError as error:
        # An error that simpick raised on purpose is complete as it is.
        if isinstance(error.cause, SimpickError):
            raise error.cause from error
        raise RuntimeError(f"episode {episode} of {config.mode} failed on the Ray cluster: {error}") from error
    if folder is not None and recording is not None:
        atomic_write_bytes(recording_file(folder, config, episode), recording)
    return result
