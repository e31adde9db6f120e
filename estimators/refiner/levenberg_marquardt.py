"""Levenberg-Marquardt over a batch of poses, with one rendering of each per iteration."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float

from simpick.estimators.refiner.alignment import Alignment, moved

_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-2, 1e-4, 1e3
_LONGEST_TURN_RAD = 0.25
_LARGEST_LOG_DEPTH = 0.08
_CONVERGED = 1.5e-3
"""A step shorter than this, in radians and log depth, ends the search."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the search ended, for n hypotheses."""

    Ts_crop_part: Float[np.ndarray, "n 4 4"]
    Ts_ahead: Float[np.ndarray, "n 4 4"]
    """The poses of the next iteration, which was not evaluated: mostly better still."""
    cost: Float[np.ndarray, "n"]
    misfit: Float[np.ndarray, "n"]


def minimise(
    Ts_crop_part: Float[np.ndarray, "n 4 4"],
    evaluate: Callable[[Float[np.ndarray, "m 4 4"], Float[np.ndarray, "m"]], Alignment],
    iterations: int,
) -> Minimum:
    """Minimise each pose's cost with at most this many evaluations.

    ``evaluate(poses, rows)`` renders and compares the poses of these rows. A step that raises the cost is undone
    and repeated with more damping (Marquardt's scaling by the Hessian's diagonal).
    """
    n = len(Ts_crop_part)
    best = Ts_crop_part.copy()
    cost, misfit = np.full(n, np.inf), np.full(n, np.inf)
    H, g = np.zeros((n, 6, 6)), np.zeros((n, 6))
    damping = np.full(n, _FIRST_DAMPING)
    trial, rows = best.copy(), np.arange(n)
    for _ in range(iterations):
        alignment = evaluate(trial[rows], rows)
        new_cost = alignment.cost.double().numpy()
        better = new_cost < cost[rows]
        accepted = rows[better]
        best[accepted], cost[accepted] = trial[accepted], new_cost[better]
        misfit[accepted] = alignment.misfit.double().numpy()[better]
        kept = torch.from_numpy(better)
        H[accepted], g[accepted] = alignment.hessian[kept].double().numpy(), alignment.gradient[kept].double().numpy()
        damping[accepted] = np.maximum(damping[accepted] / 4, _LEAST_DAMPING)
        damping[rows[~better]] *= 8
        steps = _damped_steps(H[rows], g[rows], damping[rows])
        rows, steps = _unfinished(rows, steps, damping)
        if len(rows) == 0:
            break
        trial[rows] = moved(best[rows], steps)
    return Minimum(best, trial, cost, misfit)


def _damped_steps(
    H: Float[np.ndarray, "n 6 6"], g: Float[np.ndarray, "n 6"], damping: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 6"]:
    """Solve for the steps, limited to the range in which the linearisation holds."""
    diagonal = np.einsum("nii->ni", H)
    # The floor keeps parameters without influence, such as a rotation about an axis of symmetry, from moving.
    floor = 1e-6 + 1e-4 * diagonal.max(axis=1, keepdims=True)
    A = H + (damping[:, None] * diagonal + 1e-2 * floor)[:, :, None] * np.eye(6)
    steps = -np.linalg.solve(A, g[..., None])[..., 0]
    turn = np.linalg.norm(steps[:, :3], axis=1) / _LONGEST_TURN_RAD
    zoom = np.abs(steps[:, 5]) / _LARGEST_LOG_DEPTH
    return steps / np.maximum(np.maximum(turn, zoom), 1.0)[:, None]


def _unfinished(
    rows: np.ndarray, steps: Float[np.ndarray, "n 6"], damping: Float[np.ndarray, "m"]
) -> tuple[np.ndarray, Float[np.ndarray, "k 6"]]:
    """Return the rows that have not converged, with their steps."""
    length = np.linalg.norm(steps[:, [0, 1, 2, 5]], axis=1)
    moving: Bool[np.ndarray, "n"] = (length > _CONVERGED) & (damping[rows] < _MOST_DAMPING) & np.isfinite(length)
    return rows[moving], steps[moving]
