"""Run-time shape checks for the whole package, and a private cache, during tests only."""

import os
import tempfile
from pathlib import Path

from jaxtyping import install_import_hook

from tests import runtime_types as runtime_types

# Before any simpick module is imported, so that every annotated function is checked.
_HOOK = install_import_hook("simpick", "tests.runtime_types.check")

# A test must neither find nor leave anything in the user's cache. One folder for the whole run, so that what is
# expensive to make (verified grasps, templates) is made once, also across xdist's workers.
os.environ.setdefault("SIMPICK_CACHE", str(Path(tempfile.gettempdir()) / f"simpick-tests-{os.getuid()}"))
