"""A contact sheet of parts: one labelled picture each."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

from simpick.activity import counted
from simpick.assets.part import Part
from simpick.geometry.pinhole import Pinhole
from simpick.geometry.transforms import invert, look_at
from simpick.rendering.part_views import render_part_views

_BACKGROUND = (236, 237, 240)
_INK = (40, 42, 46)
_DIRECTION = np.array([0.62, -0.62, 0.48])
_FOVY_DEG = 30.0
_DARKEST = 0.4


def contact_sheet(
    parts: Sequence[Part], labels: Sequence[str], *, columns: int = 6, cell_px: int = 240
) -> UInt8[np.ndarray, "height width 3"]:
    """Return a grid of the parts, each seen from the same direction and filling its cell, with its label below.

    Lines of a label are separated by newlines.
    """
    camera = Pinhole.from_fovy(cell_px, cell_px, _FOVY_DEG)
    line_px = max(14, cell_px // 14)
    text_px = line_px * max(label.count("\n") + 1 for label in labels) + line_px // 2
    rows = -(-len(parts) // columns)
    columns = min(columns, len(parts))
    sheet = np.full((rows * (cell_px + text_px), columns * cell_px, 3), _BACKGROUND, np.uint8)
    for k, (part, label) in enumerate(counted(list(zip(parts, labels, strict=True)), "picture")):
        row, column = divmod(k, columns)
        top, left = row * (cell_px + text_px), column * cell_px
        distance = 0.62 * part.diameter_m / np.sin(np.radians(_FOVY_DEG / 2))
        T_part_camera = look_at(distance * _DIRECTION / np.linalg.norm(_DIRECTION), np.zeros(3))
        views = render_part_views(part, invert(T_part_camera)[None], camera)
        assert views.rgb is not None
        # Renderings of parts alone are exposed to the brightest channel; here a black part must look darker.
        picture = (views.rgb[0] * max(_DARKEST, *part.material.rgb)).astype(np.uint8)
        # Edge pixels are half black where the part ends; a light rim would show, so only whole pixels are taken.
        sheet[top : top + cell_px, left : left + cell_px][views.masks[0]] = picture[views.masks[0]]
        for number, line in enumerate(label.split("\n")):
            origin = (left + 8, top + cell_px + line_px * (number + 1) - 4)
            cv2.putText(sheet, line, origin, cv2.FONT_HERSHEY_SIMPLEX, line_px / 38, _INK, 1, cv2.LINE_AA)
    return sheet
