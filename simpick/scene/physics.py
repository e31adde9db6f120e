"""Integrator, solver and contact settings: one place, so that grasps are verified in the physics they run in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import mujoco
from annotated_types import Ge, Interval

from simpick.config import Config, NonNegativeInt, PositiveInt


@dataclass(frozen=True)
class PhysicsConfig(Config):
    """Settings of the simulation. The defaults are measured choices; see each field."""

    timestep_s: Annotated[float, Interval(ge=1e-4, le=0.004)] = 0.002
    """Step of the simulation."""
    impratio: Annotated[float, Ge(1)] = 10.0
    """Friction is this much stiffer than the normal direction; pinched parts slide less."""
    noslip_iterations: NonNegativeInt = 10
    """Passes that remove the slip which soft friction leaves; without them a pinched part creeps 50-155 um/s."""
    solver_iterations: PositiveInt = 50
    """Cap on Newton iterations a step; a settled bin needs 3."""
    solver_tolerance: Annotated[float, Interval(gt=0, le=1e-2)] = 1e-8
    """Relative improvement at which the solver stops."""
    sleep: bool = True
    """Parts at rest are left out of the step until something touches them."""
    sleep_tolerance: Annotated[float, Interval(gt=0, le=0.1)] = 1e-3
    """Fastest motion (m/s, and rad/s times the part's size) that may fall asleep."""
    part_friction: Annotated[float, Interval(ge=0.05, le=2)] = 0.5
    """Coulomb coefficient between parts, and between parts and the bin."""


def apply_physics(spec: mujoco.MjSpec, physics: PhysicsConfig) -> None:
    """Set the options of `spec`: elliptic friction cones, implicitfast, and those in `physics`."""
    option = spec.option
    option.timestep = physics.timestep_s
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    option.impratio = physics.impratio
    option.noslip_iterations = physics.noslip_iterations
    option.iterations = physics.solver_iterations
    option.tolerance = physics.solver_tolerance
    option.sleep_tolerance = physics.sleep_tolerance
    # A diverged state must be seen and reported as a fault, not silently replaced by the initial one.
    option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if physics.sleep:
        option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP


def set_part_contact(geom: mujoco.MjsGeom, physics: PhysicsConfig) -> None:
    """Give a collision geom of a part, bin or chute the contact behaviour of hard machined parts."""
    geom.condim = 4
    geom.friction = [physics.part_friction, 0.002, 0.0001]
    geom.solref = [0.008, 1.0]
    geom.solimp = [0.95, 0.99, 0.001, 0.5, 2.0]


def stop_engine_log_file() -> None:
    """Keep MuJoCo from leaving a ``MUJOCO_LOG.TXT`` in the current folder; its warnings still go to stderr."""
    log = mujoco.MjLogConfig.get()
    log.logto_file = False
    log.set()
