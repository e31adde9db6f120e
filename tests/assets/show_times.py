"""How long ``simpick parts show FILE`` takes per file, from the start of the command to the written image.

``python -m tests.assets.show_times`` measures the defective meshes of `tests.assets.defective_meshes`, the parts of
`tests.assets.foreign_parts`, the library's parts as STL files, and a few dense meshes, each with an empty cache.
Times are CPU seconds of the command, which on a machine that does nothing else is what it takes on one core.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh
from manifold3d import CrossSection, Manifold

from simpick.assets import csg, library_part_names
from simpick.assets.cad_import import MAX_FACES
from tests.assets.defective_meshes import BUILDERS, library_mesh
from tests.assets.foreign_parts import write_all


def dense_meshes() -> dict[str, trimesh.Trimesh]:
    """Return meshes of many faces, in mm: a helical gear, a scan, a knurled knob, a screw and a fine bracket."""
    angle = np.linspace(0, 2 * np.pi, 480, endpoint=False)
    radius = 20 + 2.5 * np.clip(2 * np.sin(24 * angle), -1, 1)
    outline = CrossSection([np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)])
    gear = csg.cut(Manifold.extrude(outline, 12, 20, 30), csg.cylinder(5, -2, 14))
    scan = trimesh.creation.icosphere(6, 15.0)
    scan.vertices *= 1 + 0.12 * np.sin(3 * scan.vertices[:, :1] / 5)
    scan.vertices += np.random.default_rng(0).normal(scale=0.03, size=scan.vertices.shape)
    ribs = csg.ring_of(csg.box((11.5, -0.6, 0), (13, 0.6, 16)), 36)
    return {
        "gear": csg.to_trimesh(gear),
        "scan": scan,
        "knob": csg.to_trimesh(csg.union(csg.cylinder(12, 0, 16), *ribs).refine(4)),
        "screw": csg.to_trimesh(Manifold.extrude(csg.circle(5, (6, 0)), 40, 200, 720)),
        "fine_bracket": library_mesh("l_bracket").subdivide().subdivide().subdivide(),
    }


def files(folder: Path) -> Iterator[Path]:
    """Write each mesh and yield its file."""
    meshes = {name: build() for name, build in BUILDERS.items()}
    meshes |= {name: library_mesh(name) for name in library_part_names()} | dense_meshes()
    for name, mesh in meshes.items():
        assert len(mesh.faces) <= MAX_FACES
        mesh.export(folder / f"{name}.stl")
        yield folder / f"{name}.stl"
    yield from write_all(folder)


def show_time(file: Path) -> float:
    """Return the CPU time in s of showing one file with an empty cache; the command must succeed."""
    with tempfile.TemporaryDirectory() as cache:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-m", "simpick.cli.main", "parts", "show", str(file), "--out", f"{cache}/part.png"],
            env={**os.environ, "SIMPICK_CACHE": cache}, check=True, capture_output=True,
        )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    times = {}
    with tempfile.TemporaryDirectory() as folder:
        for file in files(Path(folder)):
            times[file.stem] = show_time(file)
            print(f"{file.stem:40s} {times[file.stem]:5.1f} s", flush=True)
    seconds = np.array(list(times.values()))
    median, most, worst = np.percentile(seconds, [50, 95, 100])
    print(
        f"{len(seconds)} files: median {median:.1f} s, 95 % below {most:.1f} s, worst {worst:.1f} s "
        f"({max(times, key=lambda name: times[name])}), {np.mean(seconds < 10):.1%} below 10 s"
    )
