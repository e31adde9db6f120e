"""`BinPickVectorEnv`: several bins, each simulated in its own process, with one perception for all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode
from gymnasium.vector.async_vector_env import AsyncState

from simpick.envs.bin_env import check_count
from simpick.envs.bin_pick import BinPickEnv
from simpick.errors import ConfigError, WorkerDiedError
from simpick.records import InstanceTruth


class BinPickVectorEnv(AsyncVectorEnv):
    """`num_envs` bins of `simpick/BinPick-v0`, each simulated and rendered in a worker process.

    Observations come back through shared memory, so that the calling process can run perception once for all of them
    (`simpick.policies.PoseVectorObservation`, `simpick.policies.VectorPickPolicy`). Spaces, rewards and endings are
    those of `BinPickEnv`, one row per environment; ``infos`` are gymnasium's dictionaries of arrays.

    Seeds: ``reset(seed=s)`` gives environment k the bin ``s + k``, a list gives each its own. Ended environments are
    reset by `autoreset_mode`, by default in the following step, whose action is ignored
    (`gymnasium.vector.AutoresetMode`); ``options={"reset_mask": mask}`` resets some of them at once.

    Workers are spawned, because OpenGL does not survive a fork: scripts need ``if __name__ == "__main__":``.
    An error in a worker closes the environment and is raised here as it was.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        max_concurrency: int | None = None,
        **settings: Any,
    ) -> None:
        """Start the workers. `settings` are the arguments of `BinPickEnv`, the same for every environment.

        At most `max_concurrency` environments simulate at the same time, all of them by default.

        Raises:
            ConfigError, UnknownPartError, MeshError: a setting or a part is not valid.
            WorkerDiedError: a worker process ended while it started.
        """
        self.closed = True  # Nothing to close before the workers have started.
        check_count("num_envs", num_envs, optional=False)
        check_count("max_concurrency", max_concurrency)
        try:
            mode = AutoresetMode(autoreset_mode)
        except ValueError as error:
            valid = ", ".join(mode.value for mode in AutoresetMode)
            raise ConfigError(f"autoreset_mode must be one of {valid}, got {autoreset_mode!r}") from error
        self._settings = settings
        probe = BinPickEnv(**settings)
        self.parts, self.part_names = probe.parts, probe.part_names
        self.scene_config, self.workspace = probe.scene_config, probe.workspace
        self._truths: list[tuple[InstanceTruth, ...] | None] = [None] * num_envs
        self.closed = False
        with self._explaining_deaths("Where scripts start it, they need: if __name__ == '__main__':"):
            super().__init__(
                [partial(BinPickEnv, **settings)] * num_envs,
                context="spawn",
                autoreset_mode=mode,
                max_concurrency=max_concurrency,
            )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the settings: the copy has its own workers."""
        modes = {"autoreset_mode": self.autoreset_mode, "max_concurrency": self.max_concurrency}
        return partial(type(self), self.num_envs, **modes, **self._settings), ()

    def instance_part_names(self, index: int) -> list[str]:
        """Return the part name of each instance in environment `index`, by instance number."""
        self._check_was_reset(index)
        return [self.part_names[k] for k in self.observations["instance_parts"][index] if k >= 0]

    def truth(self, index: int) -> tuple[InstanceTruth, ...]:
        """Return the true state of every part of environment `index`: for the oracle and for evaluation only."""
        return self._check_was_reset(index)

    def reset_async(self, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None) -> None:
        """Ask the workers for a reset; see `reset`."""
        with self._explaining_deaths():
            # gymnasium takes the mask out of the dictionary that it is given.
            super().reset_async(seed, None if options is None else dict(options))

    def reset_wait(self, timeout: float | None = None) -> tuple[Any, dict[str, Any]]:
        """Return what the workers answer to `reset_async`."""
        with self._explaining_deaths():
            observations, infos = super().reset_wait(timeout)
        self._keep_truth(infos)
        return observations, infos

    def step_async(self, actions: Any) -> None:
        """Hand the workers an action each; see `step`."""
        with self._explaining_deaths():
            super().step_async(actions)

    def step_wait(self, timeout: float | None = None) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Return what the workers answer to `step_async`."""
        with self._explaining_deaths():
            answer = super().step_wait(timeout)
        self._keep_truth(answer[-1])
        return answer

    def call_async(self, name: str, /, *args: object, **kwargs: object) -> None:
        """Ask every worker for an attribute of its environment, or for what a method returns; see `call`."""
        with self._explaining_deaths():
            super().call_async(name, *args, **kwargs)

    def call_wait(self, timeout: float | None = None) -> tuple[Any, ...]:
        """Return what the workers answer to `call_async`."""
        with self._explaining_deaths():
            return super().call_wait(timeout)

    def set_attr(self, name: str, values: list[Any] | tuple[Any] | object) -> None:
        """Set an attribute of every environment, a list or tuple giving each its own."""
        with self._explaining_deaths():
            super().set_attr(name, values)

    def close_extras(self, timeout: float | None = None, terminate: bool = False) -> None:
        """End the workers; those that have died already do not matter any more."""
        try:
            super().close_extras(timeout, terminate)
        except (EOFError, ConnectionError, WorkerDiedError):
            self._state = AsyncState.DEFAULT
            super().close_extras(terminate=True)

    def _keep_truth(self, infos: dict[str, Any]) -> None:
        """Keep the newest truth of each environment; one that was not reset now has none in `infos`."""
        for k in np.flatnonzero(infos.get("_truth", ())):
            names = [self.part_names[p] for p in self.observations["instance_parts"][k] if p >= 0]
            Ts_world_part, in_bin = infos["truth"]["T_world_part"][k], infos["truth"]["in_bin"][k]
            self._truths[k] = tuple(
                InstanceTruth(i, name, Ts_world_part[i].copy(), bool(in_bin[i]))
                for i, name in enumerate(names)
                if not np.isnan(Ts_world_part[i]).any()
            )

    def _check_was_reset(self, index: int) -> tuple[InstanceTruth, ...]:
        truth = self._truths[index]
        if truth is None:
            raise ConfigError(f"environment {index} has no scene yet: call reset() first")
        return truth

    def _raise_if_errors(self, successes: Iterable[bool]) -> None:
        """Raise the first worker's error as it was.

        gymnasium would call the error's class with its text, which not every class takes, and continue with the
        remaining workers, whose next call then fails for lack of the others.
        """
        if all(successes):
            return
        _, _, error, _ = self.error_queue.get()
        self._end()
        raise error

    @contextmanager
    def _explaining_deaths(self, hint: str = "") -> Iterator[None]:
        """Turn the broken pipe that a dead worker leaves into an error that names it, and close the others."""
        try:
            yield
        except (EOFError, ConnectionError) as error:
            for process in self.processes:
                process.join(0.2)
            codes = {k: process.exitcode for k, process in enumerate(self.processes) if process.exitcode is not None}
            self._end()
            raise WorkerDiedError(codes, hint) from error

    def _end(self) -> None:
        self._state = AsyncState.DEFAULT
        self.close(terminate=True)
