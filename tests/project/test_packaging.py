"""The wheel holds every module, under simpick only, and every module imports from it."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    options = ["--quiet", "--no-deps", "--no-build-isolation", "-w", str(out)]
    command = [sys.executable, "-m", "pip", "wheel", *options, "."]
    # Built from a copy, so that neither leftovers of other builds nor other test processes come into it.
    sources = tmp_path_factory.mktemp("sources")
    for name in git_files("--cached", "--others", "--exclude-standard"):
        if (ROOT / name).exists():
            (sources / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, sources / name, follow_symlinks=False)
    subprocess.run(command, cwd=sources, check=True, capture_output=True)
    return next(out.glob("*.whl"))


def git_files(*arguments: str) -> list[str]:
    command = ["git", "ls-files", "-z", *arguments]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [name for name in listed.split("\0") if name]


def test_wheel_holds_all_sources_and_nothing_generic(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {n.split("/")[0] for n in names if not n.startswith("simpick-")} == {"simpick"}
    expected = set()
    for name in git_files("*.py"):
        top = name.split("/")[0]
        if top in {"assets", "envs", "estimators"}:
            expected.add(f"simpick/{name}")
        elif top == "simpick":
            expected.add(name)
    assert not expected - set(names)
    assert sum(name.startswith("simpick/assets/grasps/") and name.endswith(".npz") for name in names) >= 56
    assert "simpick/estimators/refiner/confidence.json" in names


def test_every_module_imports_from_the_wheel(wheel: Path, tmp_path: Path) -> None:
    zipfile.ZipFile(wheel).extractall(tmp_path)
    code = (
        "import importlib, pkgutil, simpick, sys;"
        f"assert simpick.__file__.startswith({str(tmp_path)!r}), simpick.__file__;"
        "names = [m.name for m in pkgutil.walk_packages(simpick.__path__, 'simpick.')];"
        "[importlib.import_module(n) for n in names];"
        "print(len(names))"
    )
    env = {"PYTHONPATH": str(tmp_path), "PATH": "", "HOME": str(tmp_path)}
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=env, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout) > 30
