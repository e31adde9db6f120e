"""The rerun and Python commands that tests run."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def rerun(*arguments: object) -> subprocess.CompletedProcess[str]:
    # `python -m rerun_cli` would drop the exit status.
    main = "import sys; from rerun_cli.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", main, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def record_in_process(path: Path, event: str = "close") -> int:
    command = [sys.executable, "-m", "tests.recording.episode", str(path), event]
    return subprocess.run(command, capture_output=True, timeout=60, cwd=ROOT).returncode


def is_whole(path: Path) -> bool:
    return rerun("rrd", "verify", path).returncode == 0
