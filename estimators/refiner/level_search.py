"""`LevelSearch`: renders and compares hypotheses at one level."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Int

from simpick.assets.part import Part
from simpick.estimators.floor import Floor
from simpick.estimators.refiner.alignment import Alignment, Target, align
from simpick.estimators.refiner.config import AlignmentLevel, RefinerConfig
from simpick.estimators.refiner.crop_renderer import CropRenderer, rows_by_part
from simpick.estimators.refiner.query_maps import QueryMaps

_AT_ONCE = 16
"""Hypotheses that are compared at a time: their maps stay in the processor's cache."""


class LevelSearch:
    """The function that Levenberg-Marquardt minimises."""

    def __init__(
        self,
        renderer: CropRenderer,
        parts: Sequence[Part],
        level: AlignmentLevel,
        query: QueryMaps,
        floor: Floor | None,
        config: RefinerConfig,
    ) -> None:
        """Take the part of each hypothesis and the maps of its detection, one row per hypothesis."""
        self._renderer, self._parts, self._floor, self._config = renderer, parts, floor, config
        self._cameras = query.cameras
        focal_px = torch.from_numpy(query.cameras.focal_px).float()
        with torch.inference_mode():
            maps = query.brightness, query.mask, query.trust
            self._target = Target.of(*maps, focal_px, level.blur_px, level.stride)

    def evaluate(self, Ts_crop_part: Float[np.ndarray, "m 4 4"], rows: Int[np.ndarray, "m"]) -> Alignment:
        """Return how well these poses fit; `rows` says which hypotheses they belong to."""
        parts, cameras = [self._parts[k] for k in rows.tolist()], self._cameras.rows(rows)
        rendered = self._renderer.maps(parts, cameras, Ts_crop_part)
        centres = torch.from_numpy(Ts_crop_part[:, :2, 3] / Ts_crop_part[:, 2:3, 3]).float()
        with torch.inference_mode():
            target = self._target.rows(torch.from_numpy(rows))
            chunks = np.split(np.arange(len(rows)), range(_AT_ONCE, len(rows), _AT_ONCE))
            fit = Alignment.cat([align(target.rows(c), rendered.rows(c), centres[c], self._config) for c in chunks])
            if self._floor is None:
                return fit
            for part, own in rows_by_part(parts):
                cost, H, g = self._floor.equations(part, Ts_crop_part[own], cameras.Rs_crop_camera[own])
                fit.cost[own] += cost
                fit.hessian[own] += H
                fit.gradient[own] += g
            return fit
