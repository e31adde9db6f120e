"""MuJoCo ships no type information for its compiled names; without this, pyright takes each for an error."""

from typing import Any

def __getattr__(name: str) -> Any: ...
