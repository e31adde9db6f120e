"""The `Policy` protocol."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class Policy(Protocol):
    """Chooses an action from an observation of `simpick/BinPick-v0`."""

    def reset(self) -> None:
        """Forget the last episode."""
        ...

    def act(self, observation: dict[str, Any]) -> np.ndarray:
        """Return an action of the environment's action space."""
        ...
