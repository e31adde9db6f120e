"""Integrator, solver and contact settings: one place, so that grasps are verified in the physics they run in."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from simpick.errors import ConfigError


@dataclass(frozen=True)
class PhysicsConfig:
    """Settings of the simulation. The defaults are measured choices; see each field."""

    timestep_s: float = 0.002
    """Step of the simulation."""
    impratio: float = 10.0
    """Friction is this much stiffer than the normal direction; pinched parts slide less."""
    noslip_iterations: int = 10
    """Passes that remove the slip which soft friction leaves; without them a pinched part creeps 50-155 um/s."""
    solver_iterations: int = 50
    """Cap on Newton iterations a step; a settled bin needs 3."""
    solver_tolerance: float = 1e-8
    """Relative improvement at which the solver stops."""
    sleep: bool = True
    """Parts at rest are left out of the step until something touches them."""
    sleep_tolerance: float = 1e-3
    """Fastest motion (m/s, and rad/s times the part's size) that may fall asleep."""
    part_friction: float = 0.5
    """Coulomb coefficient between parts, and between parts and the bin."""

    def __post_init__(self) -> None:
        if not 1e-4 <= self.timestep_s <= 0.004:
            raise ConfigError(f"timestep_s must be between 0.0001 and 0.004 s, got {self.timestep_s}")
        if not self.impratio >= 1:
            raise ConfigError(f"impratio must be at least 1, got {self.impratio}")
        if self.noslip_iterations < 0:
            raise ConfigError(f"noslip_iterations must not be negative, got {self.noslip_iterations}")
        if self.solver_iterations < 1:
            raise ConfigError(f"solver_iterations must be at least 1, got {self.solver_iterations}")
        if not 0 < self.solver_tolerance <= 1e-2:
            raise ConfigError(f"solver_tolerance must be between 0 and 0.01, got {self.solver_tolerance}")
        if not 0 < self.sleep_tolerance <= 0.1:
            raise ConfigError(f"sleep_tolerance must be between 0 and 0.1, got {self.sleep_tolerance}")
        if not 0.05 <= self.part_friction <= 2.0:
            raise ConfigError(f"part_friction must be between 0.05 and 2, got {self.part_friction}")


def apply_physics(spec: mujoco.MjSpec, physics: PhysicsConfig) -> None:
    """Set the options of `spec`: elliptic friction cones, implicitfast, and what `physics` says."""
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
