"""Summaries of pose errors: medians and recalls at fixed angles, overall and by visibility."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from simpick.errors import ConfigError
from simpick.records import PoseError

VISIBILITY_BANDS = (0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
"""Edges of the standard visibility bands; instances less than 10 % visible are not targets."""


@dataclass(frozen=True)
class PoseSummary:
    """Summary of the pose errors of a set of instances to be found."""

    count: int
    """Number of instances, with and without estimate."""
    answered: int
    """Number of instances with an estimate."""
    median_rotation_deg: float
    """Over instances with an estimate; NaN if there are none, as for all medians."""
    median_translation_mm: float
    median_lateral_mm: float
    median_depth_mm: float
    """Of the absolute depth error."""
    median_depth_percent: float
    """The same in percent of the true depth; NaN if depths were not given."""
    median_mssd_mm: float
    recall_5_deg: float
    """Fraction of all instances with a rotation error below 5 degrees; misses count as wrong. NaN without instances."""
    recall_15_deg: float
    recall_30_deg: float


def summarize(errors: Sequence[PoseError | None], depths_m: Sequence[float] | None = None) -> PoseSummary:
    """Return the summary of these instances; None represents an instance without an estimate.

    `depths_m` are the instances' true depths along the optical axis.

    Raises:
        ConfigError: there is not one depth per error.
    """
    if depths_m is None:
        depths_m = [float("nan")] * len(errors)
    if len(errors) != len(depths_m):
        raise ConfigError(f"there must be one depth per error, got {len(depths_m)} for {len(errors)}")
    rows = []
    for e, depth_m in zip(errors, depths_m, strict=True):
        if e is not None:
            depth_mm = abs(e.depth_mm)
            rows.append((e.rotation_deg, e.translation_mm, e.lateral_mm, depth_mm, 0.1 * depth_mm / depth_m, e.mssd_mm))
    table = np.array(rows).reshape(-1, 6)
    medians = np.median(table, axis=0) if len(table) else np.full(6, np.nan)
    recalls = [float((table[:, 0] < deg).sum() / len(errors)) if errors else float("nan") for deg in (5, 15, 30)]
    return PoseSummary(len(errors), len(table), *(float(m) for m in medians), *recalls)


def summarize_by_visibility(
    errors: Sequence[PoseError | None],
    visible_fractions: Float[np.ndarray, "n"],
    depths_m: Sequence[float] | None = None,
) -> dict[str, PoseSummary]:
    """Return a summary per visibility band, named like ``30-50 %``; upper edges belong to the next band.

    The last band includes its upper edge. Instances outside all bands are left out. `depths_m` as for `summarize`.

    Raises:
        ConfigError: there is not one visible fraction per error.
    """
    if len(errors) != len(visible_fractions):
        raise ConfigError(f"there must be one visible fraction per error, got {len(visible_fractions)}")
    bands = {}
    for low, high in pairwise(VISIBILITY_BANDS):
        inside = (visible_fractions >= low) & (visible_fractions < high)
        if high == VISIBILITY_BANDS[-1]:
            inside |= visible_fractions == high
        name = f"{100 * low:.0f}-{100 * high:.0f} %"
        members = np.flatnonzero(inside).tolist()
        depths = None if depths_m is None else [depths_m[k] for k in members]
        bands[name] = summarize([errors[k] for k in members], depths)
    return bands
