"""Run by torchrun in `test_processes`: each process prints what its gradient was and what it is after averaging."""

import json
import sys
from pathlib import Path

import torch

from simpick.training.distributed import Distributed

with Distributed.from_environment("cpu") as processes:
    model = torch.nn.Linear(3, 2)
    model(torch.full((1, 3), float(processes.rank + 1))).sum().backward()
    assert model.weight.grad is not None
    before = model.weight.grad.tolist()
    processes.average_gradients(model)
    largest = processes.agree(float(processes.rank), 5.0 - processes.rank)
    result = {"before": before, "after": model.weight.grad.tolist(), "largest": largest}
    (Path(sys.argv[1]) / f"{processes.rank}.json").write_text(json.dumps(result))
