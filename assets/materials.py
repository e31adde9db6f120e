"""Materials of library parts: density and appearance."""

from __future__ import annotations

from dataclasses import dataclass

from simpick.assets.part import Material


@dataclass(frozen=True)
class Stock:
    """A raw material."""

    density_kg_m3: float
    look: Material


STEEL = Stock(7850.0, Material((0.62, 0.63, 0.65), specular=0.7, shininess=0.6))
BLACK_STEEL = Stock(7850.0, Material((0.16, 0.16, 0.18), specular=0.5, shininess=0.4))
ZINC_YELLOW = Stock(7850.0, Material((0.78, 0.68, 0.38), specular=0.6, shininess=0.5))
CAST_IRON = Stock(7200.0, Material((0.34, 0.35, 0.37), specular=0.2, shininess=0.2))
BRASS = Stock(8500.0, Material((0.80, 0.62, 0.28), specular=0.7, shininess=0.6))
BRONZE = Stock(8800.0, Material((0.68, 0.45, 0.25), specular=0.6, shininess=0.5))
COPPER = Stock(8900.0, Material((0.80, 0.47, 0.33), specular=0.6, shininess=0.5))
ALUMINIUM = Stock(2700.0, Material((0.78, 0.79, 0.81), specular=0.6, shininess=0.5))
ORANGE_PAINT = Stock(7850.0, Material((0.85, 0.42, 0.08), specular=0.4, shininess=0.4))
GREEN_PAINT = Stock(2700.0, Material((0.24, 0.42, 0.36), specular=0.3, shininess=0.3))
RED_ANODISED = Stock(2700.0, Material((0.70, 0.13, 0.12), specular=0.6, shininess=0.5))
BLUE_ANODISED = Stock(2700.0, Material((0.18, 0.32, 0.62), specular=0.6, shininess=0.5))
BLACK_NYLON = Stock(1350.0, Material((0.17, 0.17, 0.18), specular=0.4, shininess=0.3))
WHITE_POM = Stock(1410.0, Material((0.90, 0.89, 0.85), specular=0.4, shininess=0.4))
ORANGE_ABS = Stock(1180.0, Material((0.88, 0.44, 0.10), specular=0.4, shininess=0.4))
GREEN_POLYAMIDE = Stock(1350.0, Material((0.20, 0.46, 0.28), specular=0.3, shininess=0.3))
GREY_PVC = Stock(1400.0, Material((0.48, 0.51, 0.54), specular=0.3, shininess=0.3))
