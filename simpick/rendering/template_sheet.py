"""Contact sheets of template sets, to be looked at."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

from simpick.errors import ConfigError
from simpick.rendering.templates import TemplateSet

_BACKGROUND = 32


def template_sheet(
    templates: TemplateSet, *, columns: int = 18, cell_px: int = 96
) -> UInt8[np.ndarray, "height width 3"]:
    """Return all views in rows from +z down, and one last row of a slanting view turned in its plane.

    Raises:
        ConfigError: `columns` or `cell_px` is too small.
    """
    if columns < 1 or cell_px < 8:
        raise ConfigError(f"a sheet needs columns >= 1 and cell_px >= 8, got {columns} and {cell_px}")
    angles = 2 * np.pi * np.arange(columns) / columns
    turned, turned_masks, _ = templates.turned(np.full(columns, len(templates) // 6), angles)
    rows = -(-len(templates) // columns)
    blank = rows * columns - len(templates)
    images = np.concatenate([templates.rgb, np.zeros((blank, *templates.rgb.shape[1:]), np.uint8), turned])
    masks = np.concatenate([templates.masks, np.zeros((blank, *templates.masks.shape[1:]), bool), turned_masks])
    sheet = np.zeros(((rows + 1) * cell_px, columns * cell_px, 3), np.uint8)
    for k, (image, mask) in enumerate(zip(images, masks, strict=True)):
        row, column = divmod(k, columns)
        filled = np.where(mask[..., None], image, np.uint8(_BACKGROUND))
        cell = cv2.resize(filled, (cell_px, cell_px), interpolation=cv2.INTER_AREA)
        sheet[row * cell_px : (row + 1) * cell_px, column * cell_px : (column + 1) * cell_px] = cell
    return sheet
