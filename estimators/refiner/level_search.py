"""`LevelSearch`: renders and compares the hypotheses of one part at one level."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int

from simpick.assets.part import Part
from simpick.estimators.floor import Floor
from simpick.estimators.refiner.alignment import Alignment, Target, align
from simpick.estimators.refiner.config import AlignmentLevel, RefinerConfig
from simpick.estimators.refiner.crop_renderer import CropRenderer
from simpick.estimators.refiner.query_maps import QueryMaps


class LevelSearch:
    """The function that Levenberg-Marquardt minimises."""

    def __init__(
        self,
        renderer: CropRenderer,
        part: Part,
        level: AlignmentLevel,
        query: QueryMaps,
        floor: Floor | None,
        config: RefinerConfig,
    ) -> None:
        """Take the maps of each hypothesis's detection, one row per hypothesis."""
        self._renderer, self._part, self._floor, self._config = renderer, part, floor, config
        self._cameras = query.cameras
        focal_px = torch.from_numpy(query.cameras.focal_px).float()
        with torch.inference_mode():
            maps = query.brightness, query.mask, query.trust
            self._target = Target.of(*maps, focal_px, level.blur_px, level.stride)

    def evaluate(self, Ts_crop_part: Float[np.ndarray, "m 4 4"], rows: Int[np.ndarray, "m"]) -> Alignment:
        """Return how well these poses fit; `rows` says which hypotheses they belong to."""
        cameras = self._cameras.rows(rows)
        rendered = self._renderer.maps(self._part, cameras, Ts_crop_part)
        centres = torch.from_numpy(Ts_crop_part[:, :2, 3] / Ts_crop_part[:, 2:3, 3]).float()
        with torch.inference_mode():
            fit = align(self._target.rows(torch.from_numpy(rows)), rendered, centres, self._config)
            if self._floor is None:
                return fit
            cost, H, g = self._floor.equations(self._part, Ts_crop_part, cameras.Rs_crop_camera)
            return Alignment(fit.cost + cost, fit.misfit, fit.hessian + H, fit.gradient + g)
