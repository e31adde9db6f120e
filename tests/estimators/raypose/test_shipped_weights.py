"""What comes with the package: weights of both modes, small, of their mode, each with a card beside it."""

import pytest

from simpick.estimators.raypose import PRESETS, load_checkpoint
from simpick.estimators.raypose.checkpoints import shipped_checkpoint


@pytest.mark.parametrize("mode", ["coarse", "fine"])
def test_weights_of_each_mode_ship_with_a_card(mode: str) -> None:
    path = shipped_checkpoint(mode)
    assert path.stat().st_size < 16 * 2**20
    checkpoint = load_checkpoint(path)
    assert checkpoint.model.config.is_fine == (mode == "fine")
    assert checkpoint.model.config.width == PRESETS["small"].width
    card = path.with_suffix(".md").read_text()
    for fact in ("Data", "Training", "Figures", "Limits"):
        assert f"## {fact}" in card
    # The card tells of these weights, not of earlier ones.
    assert f"{checkpoint.card['queries']:,}" in card
