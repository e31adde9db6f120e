"""The pose network's opinion of which part an instance is."""

import numpy as np
import pytest
import torch

from simpick.estimators.detector.view_naming import ViewNaming
from tests.estimators.detector.conftest import SeenBin

pytestmark = pytest.mark.render


def test_true_masks_of_exposed_parts_are_mostly_named_right(seen_bin: SeenBin) -> None:
    torch.set_num_threads(1)
    ids = seen_bin.frame.instances
    assert ids is not None
    masks = [ids == k for k in range(len(seen_bin.names))]
    odds = ViewNaming().compare(seen_bin.frame, masks, seen_bin.parts)
    assert odds.shape == (len(masks), len(seen_bin.parts)) and np.isfinite(odds).all()
    names = [seen_bin.parts[k].name for k in odds.argmax(axis=1)]
    assert sum(name == truth for name, truth in zip(names, seen_bin.names, strict=True)) >= len(masks) - 1
