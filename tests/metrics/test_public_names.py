"""The package's public names exist and load late."""

import subprocess
import sys

import simpick.metrics as metrics


def test_every_name_loads() -> None:
    assert "pose_error" in metrics.__all__
    for name in metrics.__all__:
        assert callable(getattr(metrics, name))


def test_an_unknown_name_is_an_attribute_error() -> None:
    assert not hasattr(metrics, "no_such_score")


def test_importing_the_package_loads_no_heavy_library() -> None:
    code = "import sys, simpick.metrics; print({'scipy', 'trimesh', 'torch', 'mujoco'} & sys.modules.keys())"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"
