"""The OpenGL back end: chosen automatically, made explicitly, explained where it is missing.

MuJoCo decides on a back end while it is imported, and without ``MUJOCO_GL`` it decides for a window. Here the context
is made directly from the chosen back end instead, so neither the order of imports nor a display matters.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import importlib
import os
import platform
from typing import Any

from simpick.errors import RenderingUnavailableError

BACKENDS = ("egl", "osmesa", "glfw", "cgl")
"""What ``MUJOCO_GL`` may name: EGL and OSMesa render without a display, GLFW needs one, CGL is macOS's."""

_SPELLINGS = {"glx": "glfw", "wgl": "glfw", **{name: name for name in BACKENDS}}
_AUTOMATIC = ("", "enable", "enabled", "on", "true", "1")
_DISABLED = ("disable", "disabled", "off", "false", "0")
_INSTALL = (
    "Install one and run again: sudo apt-get install -y libegl1 libgl1-mesa-dri (EGL), "
    "or sudo apt-get install -y libosmesa6 (OSMesa)."
)
_WITHOUT = "Photographs of parts saved by simpick parts onboard need none: MUJOCO_GL=disabled simpick estimate ..."
_EGL_PLATFORM_DEVICE_EXT = 0x313F

_selected: str | None = None
_first_context_pid: int | None = None


def select_gl_backend() -> str:
    """Return the back end that renders in this process: ``MUJOCO_GL`` if it names one, else EGL, else OSMesa.

    An automatic choice is written to ``MUJOCO_GL``, so that child processes and MuJoCo itself follow it.

    Raises:
        RenderingUnavailableError: the named back end does not exist, rendering is switched off, or nothing works; the
            message says what to install.
    """
    global _selected
    if _selected is None:
        _selected = requested_backend() or _probe()
        os.environ["MUJOCO_GL"] = _selected
    return _selected


def requested_backend() -> str | None:
    """Return the back end that ``MUJOCO_GL`` names, None if it leaves the choice open.

    Raises:
        RenderingUnavailableError: it names none that exists, or switches rendering off.
    """
    refuse_unknown_backend()
    value = _environment()
    if value in _DISABLED:
        raise RenderingUnavailableError(f"rendering is switched off by MUJOCO_GL={value}; unset it: unset MUJOCO_GL")
    return _SPELLINGS.get(value)


def refuse_unknown_backend() -> None:
    """Raise RenderingUnavailableError if ``MUJOCO_GL`` is no name at all.

    MuJoCo itself fails on it, with a bare RuntimeError and already on import, so this is checked first.
    """
    value = _environment()
    if value not in (*_AUTOMATIC, *_DISABLED, *_SPELLINGS):
        raise RenderingUnavailableError(
            f"MUJOCO_GL must be one of {', '.join(BACKENDS)}, got {value!r}; "
            "unset it, and simpick takes the first that works: unset MUJOCO_GL"
        )


def refuse_missing_library() -> None:
    """Raise RenderingUnavailableError if ``MUJOCO_GL`` names EGL or OSMesa, and that library is not installed.

    MuJoCo itself fails on it with an AttributeError about None, and already on import, so this is checked first.
    """
    backend = _SPELLINGS.get(_environment(), "")
    library = {"egl": "EGL", "osmesa": "OSMesa"}.get(backend)
    if platform.system() == "Linux" and library is not None and ctypes.util.find_library(library) is None:
        raise RenderingUnavailableError(
            f"MUJOCO_GL={backend} needs lib{library}, which is not installed. {_INSTALL} "
            "Or let simpick take the first that works: unset MUJOCO_GL"
        )


def _environment() -> str:
    return os.environ.get("MUJOCO_GL", "").lower().strip()


def make_gl_context(width: int, height: int) -> Any:
    """Return a new OpenGL context with room for images of this size, with ``make_current``, ``as_current``, ``free``.

    Raises:
        RenderingUnavailableError: the back end fails; or this process was forked from one that had rendered, where
            software OpenGL would wait for ever for threads that a fork does not copy.
    """
    global _first_context_pid
    backend = select_gl_backend()
    if _first_context_pid not in (None, os.getpid()):
        raise RenderingUnavailableError(
            "this process was forked from one that had already rendered, and OpenGL does not survive a fork; start "
            "workers with the 'spawn' method, for instance multiprocessing.get_context('spawn') or "
            "gymnasium.make_vec(..., vector_kwargs={'context': 'spawn'})"
        )
    try:
        context = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
        # GLFW only warns where there is no display, and returns a context without a window, which crashes MuJoCo.
        if backend == "glfw" and not context._context:
            raise OSError("it made no window, which needs a display; without one, unset MUJOCO_GL")
    # The back ends raise the errors of their libraries: ImportError, OSError, AttributeError, RuntimeError, GLError.
    except Exception as error:
        raise RenderingUnavailableError(
            f"OpenGL through {backend} does not work here: {str(error).rstrip('.')}. {_INSTALL} {_WITHOUT}"
        ) from error
    _first_context_pid = os.getpid()
    # The renderer frees the context itself, after what lives in it; a collector that came first would leak that.
    type(context).__del__ = lambda self: None
    return context


def _probe() -> str:
    system = platform.system()
    if system != "Linux":
        return "cgl" if system == "Darwin" else "glfw"
    failures = []
    for backend, check in (("egl", _egl_problem), ("osmesa", _osmesa_problem)):
        problem = check()
        if problem is None:
            return backend
        failures.append(f"{backend}: {problem}")
    raise RenderingUnavailableError(f"no OpenGL back end works here ({'; '.join(failures)}). {_INSTALL}")


def _egl_problem() -> str | None:
    """Return why EGL cannot render without a display, None if it can.

    Asked through ctypes, because PyOpenGL binds itself to one platform for the life of the process on first import.
    """
    name = ctypes.util.find_library("EGL")
    if name is None:
        return "libEGL is not installed"
    try:
        egl = ctypes.CDLL(name)
        address = egl.eglGetProcAddress
    except (OSError, AttributeError) as error:
        return f"libEGL does not load ({error})"
    address.restype = ctypes.c_void_p
    pointers = [address(function) for function in (b"eglQueryDevicesEXT", b"eglGetPlatformDisplayEXT")]
    if None in pointers:
        return "libEGL knows no devices (EGL_EXT_platform_device)"
    void = ctypes.c_void_p
    query = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_int, ctypes.POINTER(void), ctypes.POINTER(ctypes.c_int))(
        pointers[0]
    )
    display_of = ctypes.CFUNCTYPE(void, ctypes.c_uint, void, void)(pointers[1])
    egl.eglInitialize.argtypes = [void, void, void]
    devices, count = (void * 16)(), ctypes.c_int(0)
    if not query(16, devices, ctypes.byref(count)) or count.value == 0:
        return "EGL finds no device, not even a software one"
    for device in devices[: count.value]:
        display = display_of(_EGL_PLATFORM_DEVICE_EXT, device, None)
        if display and egl.eglInitialize(display, None, None):
            return None
    return f"none of EGL's {count.value} devices starts"


def _osmesa_problem() -> str | None:
    name = ctypes.util.find_library("OSMesa")
    if name is None:
        return "libOSMesa is not installed"
    try:
        ctypes.CDLL(name)
    except OSError as error:
        return f"libOSMesa does not load ({error})"
    return None
