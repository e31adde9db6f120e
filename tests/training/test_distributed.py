"""Two processes under torchrun, on the CPU."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np


def test_two_processes_average_their_gradients(tmp_path: Path) -> None:
    script = Path(__file__).with_name("average_gradients.py")
    launcher = ["-m", "torch.distributed.run", "--standalone", "--nproc_per_node", "2"]
    done = subprocess.run(
        [sys.executable, *launcher, str(script), str(tmp_path)], capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    one, two = (json.loads((tmp_path / f"{rank}.json").read_text()) for rank in range(2))
    assert one["before"] != two["before"]
    assert one["after"] == two["after"]
    np.testing.assert_allclose(one["after"], np.full((2, 3), 1.5))
    assert one["largest"] == two["largest"] == [1.0, 5.0]
