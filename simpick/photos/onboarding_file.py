"""A part's onboarding in one file, for machines without OpenGL and without MuJoCo.

The file holds the part (mesh, symmetries, material, CAD frame) and what estimators and detectors made of it (templates,
descriptors): the files of the cache that onboarding reads. Loading puts those into the cache of the new machine, where
they are found under the same keys, provided that the versions of what made them are the same.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh

from simpick.assets.part import Material, Part
from simpick.bop.conventions import check_rigid
from simpick.caching import atomic_write_bytes, cache_dir, files_used, numbers, read_arrays, write_arrays
from simpick.errors import ArrayFileError, ConfigError
from simpick.estimators.base import Detector, OnboardingDetector, PoseEstimator
from simpick.estimators.boundary import onboard_part
from simpick.geometry import ContinuousSymmetry, SymmetryGroup
from simpick.json_text import load_json
from simpick.rendering.mujoco_presence import installed_mujoco
from simpick.rendering.templates import note_rendering_version, rendering_version

SUFFIX = ".simpick"
"""Of onboarding files."""
_FORMAT = "simpick onboarding 1"
_CACHED = "cache/"


def save_onboarding(path: Path, part: Part, plugins: Sequence[PoseEstimator | Detector]) -> Part:
    """Onboard a part at these estimators and detectors, write it all to one file, and return the part as it is there.

    Raises:
        ConfigError: the file's name does not end in .simpick.
        RenderingUnavailableError: templates have to be rendered, and MuJoCo or OpenGL is missing.
        OutputError: the file cannot be written.
    """
    if path.suffix != SUFFIX:
        raise ConfigError(f"an onboarding file's name must end in {SUFFIX}, got {path}")
    part = _stable(part)
    with files_used() as used:
        for plugin in plugins:
            if isinstance(plugin, PoseEstimator | OnboardingDetector):
                onboard_part(plugin, part)
    root = cache_dir()
    cached = {f.relative_to(root).as_posix(): np.frombuffer(f.read_bytes(), np.uint8) for f in dict.fromkeys(used)}
    meta = {"format": _FORMAT, "versions": _versions(rendering_version(part)), "hash": part.content_hash}
    arrays = {"meta": _text(meta), **_arrays_of(part), **{_CACHED + name: data for name, data in cached.items()}}
    write_arrays(path, arrays)
    return part


def load_onboarding(path: Path) -> Part:
    """Return the part of an onboarding file, and put what was made of it into the cache.

    Raises:
        ArrayFileError: the file is missing, damaged, or no onboarding file.
        ConfigError: it was made with other versions of simpick, torch or, where it is installed, MuJoCo.
        OutputError: the cache cannot be written.
    """
    try:
        arrays = read_arrays(path)
    except FileNotFoundError as error:
        raise ArrayFileError(
            f"no onboarding file {path}. Make it with: simpick parts onboard PART --out {shlex.quote(str(path))}"
        ) from error
    meta = _object(arrays, "meta")
    if meta.get("format") != _FORMAT:
        raise ArrayFileError(f"{path} must be an onboarding file ({_FORMAT}); make it with: simpick parts onboard")
    here, there = _versions(installed_mujoco()), meta.get("versions")
    there = there if isinstance(there, dict) else {}
    if differing := [name for name in here if here[name] not in (None, there.get(name))]:
        texts = ", ".join(f"{name} {there.get(name)} instead of {here[name]}" for name in differing)
        raise ConfigError(f"{path} was made with {texts}; install the same versions here, or make the file again")
    try:
        part = _part_from(arrays)
    except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
        raise ArrayFileError(f"{path}: the part in it is damaged ({error}); make the file again") from error
    if part.content_hash != meta.get("hash"):
        raise ArrayFileError(f"{path}: the part in it is not the one that was onboarded; make the file again")
    for name, content in arrays.items():
        target = cache_dir() / name.removeprefix(_CACHED)
        # A name such as "cache//etc/x" or "cache/../x" must not lead out of the cache.
        is_inside = ".." not in target.parts and target.is_relative_to(cache_dir())
        if name.startswith(_CACHED) and is_inside and not target.exists():
            atomic_write_bytes(target, content.tobytes())
    if here["mujoco"] is None:
        note_rendering_version(part, str(there.get("mujoco")))
    return part


def _stable(part: Part) -> Part:
    """Return the part after its way through arrays, repeated until its hash stays: axes are normalized each time."""
    for _ in range(8):
        again = _part_from(_arrays_of(part))
        if again.content_hash == part.content_hash:
            break
        part = again
    return part


def _arrays_of(part: Part) -> dict[str, np.ndarray]:
    meshes = {"mesh": part.mesh, **{f"collision_{k}": piece for k, piece in enumerate(part.collision)}}
    arrays = {}
    for name, mesh in meshes.items():
        arrays[f"{name}/vertices"], arrays[f"{name}/faces"] = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    look = part.material
    fields = {
        "name": part.name,
        "density_kg_m3": part.density_kg_m3,
        "metres_per_cad_unit": part.metres_per_cad_unit,
        "material": [list(look.rgb), look.specular, look.shininess, look.reflectance],
        "pieces": len(part.collision),
    }
    axes = np.array([[*s.axis, *s.offset_m] for s in part.symmetries.continuous]).reshape(-1, 6)
    if part.face_rgb is not None:
        arrays["face_rgb"] = part.face_rgb
    return arrays | {
        "part": _text(fields),
        "discrete": part.symmetries.discrete,
        "axes": axes,
        "T_cad_part": part.T_cad_part,
    }


def _part_from(arrays: dict[str, np.ndarray]) -> Part:
    fields = _object(arrays, "part")
    rgb, specular, shininess, reflectance = fields["material"]

    def mesh(name: str) -> trimesh.Trimesh:
        vertices, faces = (
            numbers(arrays, f"{name}/vertices", "f", None, 3),
            numbers(arrays, f"{name}/faces", "iu", None, 3),
        )
        return trimesh.Trimesh(vertices, faces, process=False)

    # The part's hash does not include these.
    name, metres = fields["name"], fields["metres_per_cad_unit"]
    if not isinstance(name, str) or not 0 < metres < math.inf:
        raise ValueError(f"a part needs a name and a unit, got {name!r} and {metres!r}"[:200])
    T_cad_part = numbers(arrays, "T_cad_part", "f", 4, 4)
    check_rigid(T_cad_part, name)

    axes = tuple(ContinuousSymmetry.of(row[:3], row[3:]) for row in numbers(arrays, "axes", "f", None, 6))
    return Part(
        name,
        mesh("mesh"),
        tuple(mesh(f"collision_{k}") for k in range(fields["pieces"])),
        SymmetryGroup(numbers(arrays, "discrete", "f", None, 4, 4), axes),
        fields["density_kg_m3"],
        Material((rgb[0], rgb[1], rgb[2]), specular, shininess, reflectance),
        T_cad_part,
        metres,
        numbers(arrays, "face_rgb", "u", None, 3) if "face_rgb" in arrays else None,
    )


def _versions(mujoco: str | None) -> dict[str, str | None]:
    return {"simpick": version("simpick"), "mujoco": mujoco, "torch": torch.__version__}


def _object(arrays: dict[str, np.ndarray], name: str) -> dict[str, Any]:
    """Return the JSON object that an array holds; empty where it holds none."""
    try:
        content = load_json(arrays[name].tobytes())
    except (KeyError, ValueError):
        content = {}
    return content if isinstance(content, dict) else {}


def _text(content: object) -> np.ndarray:
    return np.frombuffer(json.dumps(content).encode(), np.uint8)
