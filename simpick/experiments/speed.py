"""Speed of the simulator: real-time factor, images per second, share of time outside MuJoCo."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from simpick.activity import counted, doing
from simpick.envs.bin_pick import BinPickEnv
from simpick.envs.bin_servo import BinServoEnv
from simpick.experiments.config import RunConfig
from simpick.experiments.episodes import make_env, make_policy, run_configured_episode
from simpick.rendering.scene_renderer import SceneRenderer

PHYSICS = ("mj_step", "mj_forward", "mj_kinematics", "mj_camlight", "mj_collision")
RENDERING = ("mjr_render", "mjr_readPixels", "mjv_updateScene", "mjr_uploadTexture", "MjrContext")
IMAGES_TIMED = 20
SERVO_TICKS = 200


@dataclass(frozen=True)
class Speed:
    """How often something happens in a second, and how often it would if nothing but MuJoCo's own calls took time."""

    per_s: float
    limit_per_s: float

    @property
    def share(self) -> float:
        """Return the share of the limit."""
        return self.per_s / self.limit_per_s


@dataclass(frozen=True)
class SimulatorSpeed:
    """Figures of a benchmark. Times are wall-clock times where nothing else is stated."""

    attempts: int
    simulated_s: float
    """Simulated time of all attempts."""
    wall_s: float
    """Time of all attempts: simulation, rendering, perception and planning, without filling the bins."""
    reset_s: float
    """Mean time of filling a bin and making its environment."""
    steps: int
    physics_s: float
    """Spent in MuJoCo's physics functions."""
    render_s: float
    """Spent in MuJoCo's rendering functions."""
    images_per_s: dict[str, Speed]
    """Per camera: with depth and instances, and colour alone. The limit is ``mjr_render`` with ``mjr_readPixels``."""
    servo: Speed
    """Control steps of ``BinServo-v0`` without images, with random actions; medians. The limit is ``mj_step``."""


@contextmanager
def timed_functions(names: tuple[str, ...]) -> Iterator[Callable[[], float]]:
    """Time these functions of the `mujoco` module while the context lasts; yields the sum in seconds so far."""
    total = 0.0
    originals = {name: getattr(mujoco, name) for name in names if hasattr(mujoco, name)}

    def timed(function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **kwargs: Any) -> Any:
            nonlocal total
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                total += time.perf_counter() - start

        return call

    for name, function in originals.items():
        setattr(mujoco, name, timed(function))
    try:
        yield lambda: total
    finally:
        for name, function in originals.items():
            setattr(mujoco, name, function)


def measure_simulator(config: RunConfig) -> SimulatorSpeed:
    """Run the episodes of `config` and return their speed."""
    wall_s = reset_s = simulated_s = physics_s = render_s = 0.0
    attempts = 0
    with doing("a first bin, for grasps, templates and shaders"):
        run_configured_episode(config, 0)
    env = make_env(config)
    try:
        policy = make_policy(config, env, config.seed)
        for episode in counted(range(config.episodes), "bin"):
            start = time.perf_counter()
            observation, info = env.reset(seed=config.seed + episode)
            policy.reset()
            filled = time.perf_counter()
            reset_s += filled - start
            ended = info["is_success"]
            with timed_functions(PHYSICS) as physics, timed_functions(RENDERING) as rendering:
                while not ended:
                    observation, _, ended, _, info = env.step(policy.act(observation))
                    simulated_s += info["pick"].motion_s
                    attempts += 1
                physics_s += physics()
                render_s += rendering()
            wall_s += time.perf_counter() - filled
        steps = round(simulated_s / env.scene.model.opt.timestep)
        with doing("images"):
            images_per_s = _images_per_s(env)
    finally:
        env.close()
    with doing("control steps"):
        servo = measure_servo(config)
    return SimulatorSpeed(
        attempts,
        simulated_s,
        wall_s,
        reset_s / config.episodes,
        steps,
        physics_s,
        render_s,
        images_per_s,
        servo,
    )


def measure_servo(config: RunConfig) -> Speed:
    """Return how many control steps a second an arm makes that moves at random over a bin of `config`."""
    env = BinServoEnv(config.parts, config.count, config.gripper, images=())
    rng = np.random.default_rng(0)
    try:
        env.reset(seed=config.seed)
        env.step(np.zeros(7))
        ticks: list[tuple[float, float]] = []
        with timed_functions(("mj_step",)) as physics:
            ended = False
            while len(ticks) < SERVO_TICKS and not ended:
                action, physics_s, start = rng.uniform(-0.5, 0.5, 7), physics(), time.perf_counter()
                _, _, terminated, truncated, _ = env.step(action)
                ticks.append((time.perf_counter() - start, physics() - physics_s))
                ended = terminated or truncated
        # Medians: other programs on the machine interrupt few ticks, but for long.
        tick_s, limit_s = np.median(ticks, axis=0).tolist()
        return Speed(1 / tick_s, 1 / limit_s)
    finally:
        env.close()


def _images_per_s(env: BinPickEnv) -> dict[str, Speed]:
    env.reset(seed=0)
    with SceneRenderer(env.scene) as renderer:
        rates = {}
        for camera in env.scene.cameras:
            for name, depth in ((f"{camera} colour", False), (f"{camera} colour, depth, instances", True)):
                renderer.capture(camera, depth=depth, instances=depth)
                with timed_functions(("mjr_render", "mjr_readPixels")) as rendering:
                    start = time.perf_counter()
                    for _ in range(IMAGES_TIMED):
                        renderer.capture(camera, depth=depth, instances=depth)
                    wall_s = time.perf_counter() - start
                    rates[name] = Speed(IMAGES_TIMED / wall_s, IMAGES_TIMED / rendering())
    return rates
