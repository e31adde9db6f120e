"""Whether MuJoCo is installed: what renders by OpenGL needs it, estimates of onboarded parts do not."""

from __future__ import annotations

from simpick.errors import RenderingUnavailableError


def installed_mujoco() -> str | None:
    """Return the version of MuJoCo, None where it cannot be imported."""
    try:
        import mujoco
    except ImportError:
        return None
    return mujoco.__version__


def required_mujoco(what: str, otherwise: str = "") -> str:
    """Return the version of MuJoCo.

    Raises:
        RenderingUnavailableError: MuJoCo cannot be imported; the text says that `what` needs it, and `otherwise`.
    """
    try:
        import mujoco
    except ImportError as error:
        raise RenderingUnavailableError(
            f"{what} needs MuJoCo, which cannot be imported here ({error}): pip install mujoco{otherwise}"
        ) from error
    return mujoco.__version__
