"""The wheel holds every module, under simpick only, and every module imports from it."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import simpick

ROOT = Path(__file__).parents[2]


def copied_sources(folder: Path) -> Path:
    """Return a copy, so that neither leftovers of other builds nor other test processes come into a wheel."""
    for name in git_files("--cached", "--others", "--exclude-standard"):
        if (ROOT / name).exists():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name, follow_symlinks=False)
    return folder


def build(sources: Path, out: Path) -> subprocess.CompletedProcess[str]:
    options = ["--quiet", "--no-deps", "--no-build-isolation", "-w", str(out)]
    command = [sys.executable, "-m", "pip", "wheel", *options, "."]
    return subprocess.run(command, cwd=sources, capture_output=True, text=True)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    built = build(copied_sources(tmp_path_factory.mktemp("sources")), out)
    assert built.returncode == 0, built.stderr
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
    stubs = {name.replace(".pyi", ".py") for name in names if name.endswith(".pyi")}
    assert {f"simpick/{room}__init__.py" for room in ("", "assets/", "estimators/", "policies/")} <= stubs <= set(names)
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


def test_the_version_is_the_same_everywhere(wheel: Path) -> None:
    assert wheel.name.startswith(f"simpick-{simpick.__version__}-")
    assert f"\nversion: {simpick.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert f"\n## {simpick.__version__}" in (ROOT / "CHANGELOG.md").read_text()


def test_a_checkout_without_links_is_not_built(tmp_path: Path) -> None:
    sources = copied_sources(tmp_path / "sources")
    for name in ("assets", "estimators"):
        # As Git writes them where links cannot be made.
        (sources / "simpick" / name).unlink()
        (sources / "simpick" / name).write_text(f"../{name}")
    built = build(sources, tmp_path / "out")
    assert built.returncode != 0
    text = " ".join(built.stderr.split())
    assert "simpick/assets, simpick/estimators must be symbolic links to ../assets, ../estimators" in text
    assert "git clone -c core.symlinks=true" in text
    assert not list((tmp_path / "out").glob("*.whl"))
