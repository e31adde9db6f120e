"""The average follows the weights, the faster the fewer updates it has had."""

import pytest
import torch
from torch import nn

from simpick.training.moving_average import moving_average


def test_the_decay_rises_to_its_limit() -> None:
    model = nn.Linear(1, 1, bias=False)
    nn.init.zeros_(model.weight)
    average = moving_average(model, decay=0.5)
    expected = 0.0
    for n in range(1, 12):
        nn.init.constant_(model.weight, float(n))
        average.update_parameters(model)
        decay = min(0.5, (1 + n) / (10 + n))
        expected = decay * expected + (1 - decay) * n
        assert float(average.state_dict()["module.weight"]) == pytest.approx(expected)
    assert not average.training


def test_the_average_resumes_from_its_state() -> None:
    model = nn.Linear(3, 2)
    average = moving_average(model, decay=0.998)
    again = moving_average(nn.Linear(3, 2), decay=0.998)
    for _ in range(3):
        average.update_parameters(model)
    again.load_state_dict(average.state_dict())
    nn.init.normal_(model.weight)
    for each in (average, again):
        each.update_parameters(model)
    assert torch.equal(again.state_dict()["module.weight"], average.state_dict()["module.weight"])
