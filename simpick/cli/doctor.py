"""``simpick doctor``: what is installed, what works, and what to fix."""

from __future__ import annotations

import importlib.metadata
import platform
import shlex
import shutil
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

Check = Literal["python", "packages", "gl", "torch", "cache", "disk"]
CORE_PACKAGES = ("mujoco", "gymnasium", "torch", "rerun-sdk", "mink", "trimesh", "manifold3d", "numpy")
MIN_FREE_GB = 2.0


@dataclass(frozen=True)
class Finding:
    """The result of one check."""

    check: str
    ok: bool
    detail: str
    remedy: str = ""


@dataclass(frozen=True)
class Doctor:
    """Check the installation and report what to fix."""

    only: Annotated[tuple[Check, ...], tyro.conf.arg(help_behavior_hint="(default: all checks)")] = ()
    """Run only these checks."""

    def run(self) -> int:
        """Print the findings; return 1 if anything needs to be fixed."""
        from simpick.terminal import Console, Text, narrow_table

        findings = [CHECKS[name]() for name in self.only or CHECKS]
        table = narrow_table("check", "", "found", "fix", labels=4, padding=2)
        for finding in findings:
            mark = Text("ok", "green") if finding.ok else Text("failed", "red")
            table.add_row(finding.check, mark, finding.detail, finding.remedy)
        Console().print(table)
        return 0 if all(finding.ok for finding in findings) else 1


def check_python() -> Finding:
    """Check the interpreter's version."""
    ok = sys.version_info >= (3, 11)
    found = f"{platform.python_version()} on {platform.machine()}"
    return Finding("python", ok, found, "" if ok else "use Python 3.11 or newer")


def check_packages() -> Finding:
    """Check that the core packages are installed; report their versions."""
    found, missing = [], []
    for name in CORE_PACKAGES:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    remedy = f"pip install {shlex.join(missing)}" if missing else ""
    return Finding("packages", not missing, ", ".join(found), remedy)


def check_gl() -> Finding:
    """Render one frame and check that it shows the scene."""
    from simpick.rendering.mujoco_presence import installed_mujoco

    if installed_mujoco() is None:
        return Finding("gl", False, "no MuJoCo", "pip install mujoco")
    import mujoco
    import numpy as np

    from simpick.errors import SimpickError
    from simpick.geometry import Pinhole, look_at
    from simpick.rendering import Renderer, Viewpoint, select_gl_backend

    try:
        backend = select_gl_backend()
        model = mujoco.MjModel.from_xml_string(
            "<mujoco><worldbody><light pos='0 0 3'/><geom size='0.5' rgba='1 0 0 1'/></worldbody></mujoco>"
        )
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        viewpoint = Viewpoint(Pinhole.from_fovy(64, 64, 45), look_at(np.array([0.0, -2.0, 1.0]), np.zeros(3)))
        with Renderer(model, 64, 64) as renderer:
            image = renderer.render(data, viewpoint, rgb=True, depth=False, geoms=False).rgb
    except SimpickError as error:
        return Finding("gl", False, "no OpenGL", str(error))
    seen = image is not None and bool(image[..., 0].max() > 50)
    return Finding("gl", seen, f"{backend} renders" if seen else f"{backend} renders black frames")


def check_torch() -> Finding:
    """Report the device that torch uses."""
    import torch

    if torch.cuda.is_available():
        return Finding("torch", True, f"{torch.__version__}, {torch.cuda.get_device_name(0)}")
    return Finding("torch", True, f"{torch.__version__}, CPU with {torch.get_num_threads()} threads")


def check_cache() -> Finding:
    """Check that the cache folder can be written."""
    from simpick.caching import cache_dir

    folder = cache_dir()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        return Finding("cache", False, f"{folder}: {error.strerror}", "point SIMPICK_CACHE at a folder you may write")
    size_mb = sum(f.stat().st_size for f in folder.rglob("*") if f.is_file()) / 1e6
    return Finding("cache", True, f"{folder}, {size_mb:.0f} MB")


def check_disk() -> Finding:
    """Check that there is room for recordings in the working folder."""
    free_gb = shutil.disk_usage(Path.cwd()).free / 1e9
    ok = free_gb >= MIN_FREE_GB
    return Finding("disk", ok, f"{free_gb:.1f} GB free here", "" if ok else f"free {MIN_FREE_GB:.0f} GB, or use --out")


CHECKS: dict[str, Callable[[], Finding]] = {
    "python": check_python,
    "packages": check_packages,
    "gl": check_gl,
    "torch": check_torch,
    "cache": check_cache,
    "disk": check_disk,
}
