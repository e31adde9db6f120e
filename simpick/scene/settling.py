"""Filling the bin: parts fall in layers, at random positions and orientations, until all rest inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from simpick.assets.part import Part
from simpick.errors import SceneError
from simpick.geometry.transforms import random_rotation, so3_exp, transform
from simpick.scene.composition import body_name, compose_settling
from simpick.scene.config import SceneConfig
from simpick.scene.parking import park, release
from simpick.scene.sleep import wake_all
from simpick.scene.workspace import bin_interior, bin_zone

MAX_PENETRATION_M = 0.001
"""Two parts that overlap deeper than this at rest have run into each other; one is dropped again."""
STILL_SPEED = 5e-3
"""Below this speed (m/s, and rad/s times the part's radius) a part counts as still."""
_STILL_WINDOW_S = 0.1
_LAYER_S = 0.25
_SLOW_S = 3.0
_FREE_S = 3.0
_ROUNDS = 10
_ROUNDS_WITHOUT_GAIN = 3
_LAYER_PARTS = 6
_TRIALS = 20
# Parts fall as if through honey, at most at gravity / rate = 0.65 m/s: faster ones would pass through thin walls
# of other parts within a step. The last stretch is simulated without it.
_DRAG_RATE_1_S = 15.0
# Standard deviation about each axis of aligned orientations.
_ALIGNED_RAD = 0.08


@dataclass(frozen=True, eq=False)
class Settled:
    """Where the parts came to rest."""

    qpos: Float[np.ndarray, "count 7"]
    """Position (m) and quaternion wxyz of every instance."""
    redropped: int
    """How many times a part had left the bin or run into another one, and was dropped again."""


def settle(config: SceneConfig, parts: Sequence[Part], rng: np.random.Generator, *, aligned: bool = False) -> Settled:
    """Drop every part into the bin and wait until all rest inside it and do not overlap.

    Parts fall in random orientations, or, if `aligned`, nearly in a common one, so that many lie flush on one another.
    The arm stays out of it: it is far from the bin, and parts alone are quicker to simulate. Raises SceneError if
    some parts do not stay in the bin.
    """
    return _Dropping(config, parts, rng, aligned).run()


class _Dropping:
    def __init__(self, config: SceneConfig, parts: Sequence[Part], rng: np.random.Generator, aligned: bool) -> None:
        self._config, self._parts, self._rng = config, parts, rng
        self._common = random_rotation(rng) if aligned else None
        self._model = compose_settling(config, parts).compile()
        # A part that balances on its edge moves slowly at first: it must not fall asleep there.
        self._model.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
        self._data = mujoco.MjData(self._model)
        self._radius = np.array([part.diameter_m / 2 for part in parts])
        self._inside = np.zeros(len(parts), bool)

    def run(self) -> Settled:
        model, data = self._model, self._data
        for k in range(len(self._parts)):
            park(model, data, body_name(k), k)
        wake_all(model, data)
        waiting = list(range(len(self._parts)))
        redropped, fewest, without_gain = 0, len(waiting), 0
        for _ in range(_ROUNDS):
            self._set_drag(_DRAG_RATE_1_S)
            while waiting:
                waiting = self._drop_layer(waiting)
                self._advance(_LAYER_S)
            self._until_still(_SLOW_S, windows=1)
            waiting = self._escaped() or self._colliding()
            if not waiting:
                self._set_drag(0.0)
                self._until_still(_FREE_S, windows=3)
                waiting = self._escaped() or self._colliding()
            if not waiting:
                return Settled(data.qpos.reshape(-1, 7).copy(), redropped)
            redropped += len(waiting)
            without_gain = 0 if len(waiting) < fewest else without_gain + 1
            fewest = min(fewest, len(waiting))
            if without_gain >= _ROUNDS_WITHOUT_GAIN:
                break
            for k in waiting:
                park(model, data, body_name(k), k)
                self._inside[k] = False
            wake_all(model, data)
        names = ", ".join(sorted({self._parts[k].name for k in waiting}))
        raise SceneError(
            f"{len(waiting)} of {len(self._parts)} parts ({names}) did not come to rest in the bin, however often"
            " they were dropped; take fewer parts or a larger bin"
        )

    def _drop_layer(self, waiting: list[int]) -> list[int]:
        """Release waiting parts side by side above the pile, at random positions; return those still waiting."""
        room = bin_interior(self._config.bin)
        pile = [float(self._data.qpos[7 * k + 2] + self._radius[k]) for k in np.flatnonzero(self._inside)]
        top = max([0.0, *pile])
        placed: list[tuple[np.ndarray, float]] = []
        rest: list[int] = []
        for k in waiting:
            radius = self._radius[k]
            # A part longer than the bin is wide starts in the middle: it slides in, or is dropped again.
            slack = np.maximum(room.size_m[:2] / 2 - radius, 0.0)
            xy = self._free_place(room.centre_m[:2], slack, radius, placed) if len(placed) < _LAYER_PARTS else None
            if xy is None:
                rest.append(k)
                continue
            placed.append((xy, radius))
            T_world_part = transform(self._orientation(), np.array([*xy, top + radius + 0.002]))
            release(self._model, self._data, body_name(k), T_world_part)
            self._inside[k] = True
        wake_all(self._model, self._data)
        return rest

    def _orientation(self) -> Float[np.ndarray, "3 3"]:
        if self._common is None:
            return random_rotation(self._rng)
        half_turns = np.array([0.0, 0.0, np.pi * self._rng.integers(2)])
        return so3_exp(self._rng.normal(0, _ALIGNED_RAD, 3) + half_turns) @ self._common

    def _free_place(
        self, centre: Float[np.ndarray, "2"], slack: Float[np.ndarray, "2"], radius: float, placed: list
    ) -> Float[np.ndarray, "2"] | None:
        """Return a random place at which a part touches no other of its layer, or None after a few trials."""
        for _ in range(_TRIALS):
            xy = centre + self._rng.uniform(-1, 1, 2) * slack
            if all(np.linalg.norm(xy - other) > radius + other_radius for other, other_radius in placed):
                return xy
        return None

    def _set_drag(self, rate: float) -> None:
        """Oppose every motion with an acceleration of `rate` times the velocity."""
        model = self._model
        for k in range(len(self._parts)):
            body = model.body(body_name(k))
            dof = int(model.joint(body_name(k)).dofadr[0])
            model.dof_damping[dof : dof + 3] = rate * body.mass
            model.dof_damping[dof + 3 : dof + 6] = rate * body.inertia.max()
        # The exact friction of the simulation proper is only needed once the parts are about to rest.
        model.opt.noslip_iterations = 0 if rate > 0 else self._config.physics.noslip_iterations

    def _advance(self, duration_s: float) -> None:
        steps = max(round(duration_s / self._model.opt.timestep), 1)
        mujoco.mj_step(self._model, self._data, nstep=steps)
        if not np.all(np.isfinite(self._data.qpos)):
            raise SceneError("the physics diverged while parts were settling; try another seed or a smaller timestep_s")

    def _until_still(self, limit_s: float, windows: int) -> None:
        """Simulate until no part has moved for several windows in a row, or the limit is reached."""
        deadline = self._data.time + limit_s
        before = self._data.qpos.reshape(-1, 7).copy()
        still = 0
        while still < windows and self._data.time < deadline:
            self._advance(_STILL_WINDOW_S)
            after = self._data.qpos.reshape(-1, 7).copy()
            shift = np.linalg.norm(after[:, :3] - before[:, :3], axis=1)
            # The half angle between two unit quaternions, times the diameter, is how far the part's rim turned.
            turn = np.arccos(np.clip(np.abs(np.sum(after[:, 3:] * before[:, 3:], axis=1)), 0, 1)) * 2 * self._radius
            moved = np.maximum(shift, turn)[self._inside].max(initial=0.0)
            still = still + 1 if moved < STILL_SPEED * _STILL_WINDOW_S else 0
            before = after

    def _escaped(self) -> list[int]:
        positions = self._data.qpos.reshape(-1, 7)[:, :3]
        return [int(k) for k in np.flatnonzero(~bin_zone(self._config.bin).contains(positions))]

    def _colliding(self) -> list[int]:
        """Return the upper part of every pair that overlaps too deeply, and parts that are stuck in a wall."""
        wake_all(self._model, self._data)
        heights = self._data.qpos.reshape(-1, 7)[:, 2]
        contact = self._data.contact
        found: set[int] = set()
        first = self._model.body(body_name(0)).id
        for geoms in contact.geom[contact.dist < -MAX_PENETRATION_M]:
            instances = [int(b) - first for b in self._model.geom_bodyid[geoms] if b >= first]
            found.add(max(instances, key=lambda k: heights[k]))
        return sorted(found)
