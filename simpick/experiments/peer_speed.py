"""Speed of other packages' manipulation environments on this machine, as a scale for simpick's own.

They need other versions of MuJoCo, so they run in a process of their own, which may be of another environment's Python:
this file is also its program, and imports nothing of simpick.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

STEPS = 200
_LIMIT_S = 300
_LAST_LINE = 200
"""Characters of an error that are shown."""


@dataclass(frozen=True)
class PeerSpeed:
    """Control steps per second of an environment without images, with random actions."""

    environment: str
    package: str
    """With its version, if it is installed."""
    mujoco: str | None
    """Version that it ran on."""
    per_s: float | None
    """None if it could not be measured."""
    limit_per_s: float | None
    """If nothing but MuJoCo's steps took time."""
    missing: str | None
    """Why it could not be measured, and what to do."""


def measure_peers(python: Path | None = None) -> list[PeerSpeed]:
    """Return the speed of each known environment, as the given Python finds it, by default this one."""
    command = [str(python or sys.executable), str(Path(__file__).resolve())]
    rows = []
    for environment, package, _ in _ENVIRONMENTS:
        found: dict[str, Any] = {"missing": None, "mujoco": None, "per_s": None, "limit_per_s": None}
        try:
            run = subprocess.run([*command, environment], capture_output=True, text=True, timeout=_LIMIT_S)
            # Packages print of their own.
            found |= json.loads(run.stdout.strip().splitlines()[-1])
        except (OSError, ValueError, IndexError, subprocess.TimeoutExpired) as error:
            found["missing"] = f"{command[0]} gave no figures: {error}"[:_LAST_LINE]
        rows.append(PeerSpeed(environment, found.pop("package", package), **found))
    return rows


def _fetch() -> Callable[[], object]:
    gymnasium = import_module("gymnasium")
    gymnasium.register_envs(import_module("gymnasium_robotics"))
    env = gymnasium.make("FetchPickAndPlace-v4", max_episode_steps=STEPS + 2)
    env.reset(seed=0)
    env.action_space.seed(0)
    return lambda: env.step(env.action_space.sample())


def _pick_place() -> Callable[[], object]:
    numpy, robosuite = import_module("numpy"), import_module("robosuite")
    env = robosuite.make(
        "PickPlace",
        robots="Panda",
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        ignore_done=True,
    )
    env.reset()
    lower, upper = env.action_spec
    rng = numpy.random.default_rng(0)
    return lambda: env.step(rng.uniform(lower, upper))


_ENVIRONMENTS = (
    ("FetchPickAndPlace", "gymnasium-robotics", _fetch),
    ("PickPlace", "robosuite", _pick_place),
)


def _measured(step: Callable[[], object]) -> dict[str, float]:
    """Time steps, and within them what MuJoCo's own steps take."""
    mujoco, inside_s = import_module("mujoco"), 0.0

    def timed(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            nonlocal inside_s
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                inside_s += time.perf_counter() - start

        return call

    for name in ("mj_step", "mj_step1", "mj_step2"):
        setattr(mujoco, name, timed(getattr(mujoco, name)))
    step()
    inside_s, start = 0.0, time.perf_counter()
    for _ in range(STEPS):
        step()
    return {"per_s": STEPS / (time.perf_counter() - start), "limit_per_s": STEPS / inside_s}


def main(environment: str) -> None:
    """Print the figures of one environment as a line of JSON."""
    package, make = next((package, make) for name, package, make in _ENVIRONMENTS if name == environment)
    try:
        found: dict[str, Any] = {"package": f"{package} {version(package)}", "mujoco": version("mujoco")}
    except PackageNotFoundError as error:
        print(json.dumps({"missing": f"{error.name} is not installed: pip install {package}"}))
        return
    try:
        found |= _measured(make())
    except Exception as error:  # Whatever another package raises is no reason to stop.
        text = f"{type(error).__name__} {error}".strip()[:_LAST_LINE]
        found["missing"] = f"does not run with MuJoCo {found['mujoco']}: {text}; name a Python with --peer-python"
    print(json.dumps(found))


if __name__ == "__main__":
    main(sys.argv[1])
