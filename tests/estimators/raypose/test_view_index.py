"""The index of a part's views: a view finds itself, poses differ, and the cache gives the same."""

import numpy as np
import pytest
import torch

from simpick.assets.library import get_part
from simpick.estimators.raypose.crops.aimed_templates import aim_at_templates
from simpick.estimators.raypose.crops.template_crops import TemplateImages, crop_templates
from simpick.estimators.raypose.network.config import PRESETS
from simpick.estimators.raypose.network.model import RayPose
from simpick.estimators.raypose.view_index import TURNS, ViewIndex, load_view_index
from simpick.geometry import rotation_angle
from simpick.rendering import TemplateConfig, load_templates

pytestmark = pytest.mark.render
PART = get_part("crank_arm")
TEMPLATES = TemplateConfig(views=12, size_px=48)


@pytest.fixture(scope="module")
def model() -> RayPose:
    torch.manual_seed(0)
    return RayPose(PRESETS["tiny"]).eval()


@pytest.fixture(scope="module")
def index(model: RayPose) -> ViewIndex:
    return load_view_index(model, PART, load_templates(PART, TEMPLATES))


def test_a_view_finds_its_own_pose(model: RayPose, index: ViewIndex) -> None:
    templates = load_templates(PART, TEMPLATES)
    views, angles = np.array([0, 4, 9]), 2 * np.pi * np.array([0, 7, 23]) / TURNS
    aimed = aim_at_templates(templates, views, angles, model.config)
    crops = crop_templates(TemplateImages.of(templates), aimed, model.config)
    with torch.inference_mode():
        embeddings = model.embed_views(crops.rgb, crops.masks)
        half_tangents = torch.tensor(crops.half_tangent, dtype=torch.float32)
        found = index.search(model, PART, embeddings, half_tangents, 5)
    for (Ts, scores), T in zip(found, crops.Ts_crop_part, strict=True):
        np.testing.assert_allclose(Ts[0], T, atol=1e-5)
        assert 1 <= len(Ts) <= 5 and (np.diff(scores) <= 0).all()
        apart = np.degrees(rotation_angle(Ts[:, None, :3, :3] @ np.swapaxes(Ts[:, :3, :3], -1, -2)))
        assert apart[~np.eye(len(Ts), dtype=bool)].min(initial=180.0) > 20 - 1e-3


def test_distance_follows_from_the_querys_angle(model: RayPose, index: ViewIndex) -> None:
    with torch.inference_mode():
        wide, narrow = index.search(model, PART, index.embeddings[:1].repeat(2, 1), torch.tensor([0.10, 0.05]), 1)
    assert narrow[0][0, 2, 3] == pytest.approx(2 * wide[0][0, 2, 3], rel=1e-5)


def test_the_cache_gives_the_same_and_other_weights_another(
    model: RayPose, index: ViewIndex, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("simpick.estimators.raypose.view_index._embed", lambda *_: pytest.fail("it is cached"))
    templates = load_templates(PART, TEMPLATES)
    assert torch.equal(load_view_index(model, PART, templates).embeddings, index.embeddings)
    monkeypatch.undo()
    torch.manual_seed(1)
    other = load_view_index(RayPose(PRESETS["tiny"]).eval(), PART, templates)
    assert not torch.allclose(other.embeddings, index.embeddings)
