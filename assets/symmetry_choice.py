"""How the symmetries of a CAD file are determined; on its own because the command line's help needs nothing else."""

from __future__ import annotations

from typing import Literal, TypeAlias

SymmetryChoice: TypeAlias = Literal["auto", "none", "revolution"]
"""Detected, none, or all rotations about the axis that is nearest to being one of revolution."""
