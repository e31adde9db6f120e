"""What comes with the package: small weights that serve both modes, with a card beside them."""

from simpick.estimators.raypose import PRESETS, load_checkpoint
from simpick.estimators.raypose.checkpoints import shipped_checkpoint


def test_weights_ship_with_a_card() -> None:
    path = shipped_checkpoint()
    assert path.stat().st_size < 16 * 2**20
    checkpoint = load_checkpoint(path)
    assert checkpoint.model.config.is_fine
    assert checkpoint.model.config.width == PRESETS["small"].width
    card = path.with_suffix(".md").read_text()
    for fact in ("Data", "Training", "Figures", "Limits"):
        assert f"## {fact}" in card
    # The card describes these weights, not of earlier ones.
    assert f"{checkpoint.card['queries']:,}" in card
