"""A tiny data set of two parts, one scene and two images, as simpick writes it."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from simpick.assets.part import Part
from simpick.bop import BopInstance, BopWriter
from simpick.geometry.pinhole import Pinhole
from simpick.geometry.symmetry import SymmetryGroup
from simpick.geometry.transforms import look_at, random_rotation, so3_exp, transform
from simpick.records import CameraFrame

WIDTH, HEIGHT = 64, 48


@pytest.fixture(scope="session")
def parts() -> tuple[Part, Part]:
    """A block whose CAD frame is rotated and moved, and a rod with a continuous symmetry off its CAD frame's origin."""
    block, rod = trimesh.creation.box((0.03, 0.05, 0.02)), trimesh.creation.cylinder(0.01, 0.06)
    T_cad_block = transform(so3_exp(np.array([0.1, 0.2, 0.3])), np.array([0.01, 0.02, 0.03]))
    T_cad_rod = transform(translation=np.array([0.0, -0.02, 0.005]))
    return (
        Part("block", block, (block,), SymmetryGroup.cyclic(2, flips=True), T_cad_part=T_cad_block),
        Part("rod", rod, (rod,), SymmetryGroup.revolution(flip=True), T_cad_part=T_cad_rod),
    )


@pytest.fixture(scope="session")
def frames() -> tuple[CameraFrame, ...]:
    rng = np.random.default_rng(0)
    camera = Pinhole(WIDTH, HEIGHT, 80.3, 80.1, 31.7, 24.9)
    return tuple(
        CameraFrame(
            rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8),
            camera,
            look_at(np.array([0.1 * k, 0.2, 0.9]), np.zeros(3)),
            np.where(rng.random((HEIGHT, WIDTH)) < 0.2, 0.0, rng.uniform(0.3, 2.0, (HEIGHT, WIDTH))).astype(np.float32),
        )
        for k in range(2)
    )


@pytest.fixture(scope="session")
def instances() -> tuple[BopInstance, ...]:
    """A block, half hidden; a rod, wholly seen; and a rod of which nothing is seen."""
    rng = np.random.default_rng(1)
    boxes = ((10, 5, 20, 13), (30, 20, 41, 40), (0, 0, 6, 7))
    masks = np.zeros((3, HEIGHT, WIDTH), bool)
    for mask, (x0, y0, x1, y1) in zip(masks, boxes, strict=True):
        mask[y0:y1, x0:x1] = True
    half = masks[0].copy()
    half[:9] = False
    poses = [transform(random_rotation(rng), np.array([0.05 * k, 0.01, 0.6])) for k in range(3)]
    return (
        BopInstance("block", poses[0], masks[0], half),
        BopInstance("rod", poses[1], masks[1], masks[1]),
        BopInstance("rod", poses[2], masks[2], np.zeros_like(masks[2])),
    )


@pytest.fixture
def root(tmp_path: Path, parts, frames, instances) -> Path:
    """The data set's folder; scene 4 has two images with the same instances."""
    with BopWriter(tmp_path / "tiny", parts) as writer:
        for frame in frames:
            writer.add(4, frame, instances)
    return tmp_path / "tiny"
