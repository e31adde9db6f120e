import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from simpick.errors import RenderingUnavailableError
from simpick.rendering import gl


@pytest.fixture(autouse=True)
def fresh_choice(monkeypatch):
    monkeypatch.setattr(gl, "_selected", None)
    monkeypatch.delenv("MUJOCO_GL", raising=False)


def test_an_unknown_name_is_refused_before_mujoco_is_imported():
    code = (
        "import simpick.errors\n"
        "try:\n    import simpick.rendering\n"
        "except simpick.errors.RenderingUnavailableError as e: print(e)"
    )
    env = {**os.environ, "MUJOCO_GL": "bogus"}
    out = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert out.stdout.strip() == (
        "MUJOCO_GL must be one of egl, osmesa, glfw, cgl, got 'bogus'; "
        "unset it, and simpick takes the first that works: unset MUJOCO_GL"
    )


def test_an_environment_refuses_an_unknown_name_before_mujoco_is_imported():
    code = (
        "import gymnasium, simpick, simpick.errors\n"
        "try:\n    gymnasium.make('simpick/BinPick-v0')\n"
        "except simpick.errors.RenderingUnavailableError as e: print(e)"
    )
    env = {**os.environ, "MUJOCO_GL": "bogus"}
    out = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True)
    assert out.stdout.startswith("MUJOCO_GL must be one of egl, osmesa, glfw, cgl, got 'bogus'; unset it")


@pytest.mark.parametrize(("name", "library"), [("osmesa", "OSMesa"), ("EGL", "EGL")])
def test_a_chosen_back_end_whose_library_is_missing_is_refused(monkeypatch, name, library):
    monkeypatch.setenv("MUJOCO_GL", name)
    monkeypatch.setattr(gl.platform, "system", lambda: "Linux")
    monkeypatch.setattr(gl.ctypes.util, "find_library", lambda name: None)
    with pytest.raises(RenderingUnavailableError, match=f"MUJOCO_GL={name.lower()} needs lib{library}, which"):
        gl.refuse_missing_library()
    monkeypatch.setattr(gl.ctypes.util, "find_library", lambda name: f"lib{name}.so")
    gl.refuse_missing_library()


def test_without_a_choice_no_library_is_asked_for(monkeypatch):
    monkeypatch.setattr(gl.ctypes.util, "find_library", lambda name: pytest.fail("asked"))
    gl.refuse_missing_library()


def test_glfw_without_a_display_is_refused_instead_of_crashing(monkeypatch):
    class Windowless:
        def __init__(self, width, height):
            self._context = None

    monkeypatch.setenv("MUJOCO_GL", "glfw")
    monkeypatch.setattr(gl.importlib, "import_module", lambda name: SimpleNamespace(GLContext=Windowless))
    monkeypatch.setattr(gl, "_first_context_pid", None)
    with pytest.raises(RenderingUnavailableError, match=r"glfw does not work here: it made no window, which needs"):
        gl.make_gl_context(8, 8)


def test_rendering_switched_off_says_so(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "off")
    with pytest.raises(RenderingUnavailableError, match=r"switched off by MUJOCO_GL=off; unset it: unset MUJOCO_GL"):
        gl.select_gl_backend()


def test_an_explicit_back_end_wins_without_being_tried(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "OSMesa")
    monkeypatch.setattr(gl, "_egl_problem", lambda: pytest.fail("EGL was tried"))
    assert gl.select_gl_backend() == "osmesa"


def test_osmesa_comes_after_egl_and_children_follow(monkeypatch):
    monkeypatch.setattr(gl.platform, "system", lambda: "Linux")
    monkeypatch.setattr(gl, "_egl_problem", lambda: "libEGL is not installed")
    monkeypatch.setattr(gl, "_osmesa_problem", lambda: None)
    assert gl.select_gl_backend() == "osmesa"
    assert os.environ["MUJOCO_GL"] == "osmesa"


def test_without_any_back_end_the_error_names_the_packages(monkeypatch):
    monkeypatch.setattr(gl.platform, "system", lambda: "Linux")
    monkeypatch.setattr(gl.ctypes.util, "find_library", lambda name: None)
    with pytest.raises(RenderingUnavailableError) as error:
        gl.select_gl_backend()
    assert str(error.value) == (
        "no OpenGL back end works here (egl: libEGL is not installed; osmesa: libOSMesa is not installed). "
        "Install one and run again: sudo apt-get install -y libegl1 libgl1-mesa-dri (EGL), "
        "or sudo apt-get install -y libosmesa6 (OSMesa)."
    )


def test_a_back_end_that_fails_is_named_with_its_own_reason(monkeypatch):
    def fail(name):
        raise OSError("libEGL.so.1: cannot open shared object file")

    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setattr(gl.importlib, "import_module", fail)
    with pytest.raises(RenderingUnavailableError, match=r"egl does not work here: libEGL.*apt-.*MUJOCO_GL=disabled"):
        gl.make_gl_context(8, 8)


@pytest.mark.render
@pytest.mark.skipif(sys.platform != "linux", reason="forks")
def test_a_child_forked_before_anything_was_rendered_can_render():
    code = (
        "import multiprocessing\n"
        "from simpick.rendering.gl import make_gl_context, select_gl_backend\n"
        "select_gl_backend()\n"
        "child = multiprocessing.get_context('fork').Process(target=make_gl_context, args=(8, 8))\n"
        "child.start(); child.join(60); print(child.exitcode)"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert out.stdout.strip() == "0"


def test_a_forked_child_is_refused_instead_of_hanging(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setattr(gl, "_first_context_pid", os.getpid() + 1)
    with pytest.raises(RenderingUnavailableError, match=r"does not survive a fork; start workers with the 'spawn'"):
        gl.make_gl_context(8, 8)
