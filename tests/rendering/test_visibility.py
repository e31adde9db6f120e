import numpy as np
import pytest

from simpick.geometry import Pinhole
from simpick.rendering import SceneRenderer, measure_visibility, visible_fractions

pytestmark = pytest.mark.render


def test_a_part_half_hidden_has_about_half_its_silhouette_visible(boxes):
    with SceneRenderer(boxes) as renderer:
        fractions = visible_fractions(renderer)
        frame = renderer.capture()
    # The upper box spans x > 0 and, being nearer, hides the lower one from the middle on, by projection.
    assert fractions[1] == 1.0
    assert fractions[0] == pytest.approx(0.5, abs=0.05)
    visibility = measure_visibility_of(boxes, 0)
    assert visibility.visible_px == (frame.instances == 0).sum()


def test_silhouettes_contain_what_is_visible(boxes):
    with SceneRenderer(boxes) as renderer:
        frame = renderer.capture()
        for v in measure_visibility(renderer):
            silhouette = v.silhouette(frame.camera.height, frame.camera.width)
            assert not ((frame.instances == v.instance) & ~silhouette).any()
            assert silhouette.sum() == v.silhouette_px


def test_a_part_cut_by_the_image_border_counts_its_whole_silhouette(boxes):
    whole = measure_visibility_of(boxes, 1)
    camera, T = boxes.camera("overhead")
    # The same camera with the image's origin moved, so that the border runs through the part.
    shifted = Pinhole(camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy - 38)
    boxes.camera = lambda name: (shifted, T)
    cut = measure_visibility_of(boxes, 1)
    assert cut.silhouette_px == whole.silhouette_px
    assert 0 < cut.visible_px < whole.visible_px
    np.testing.assert_allclose(cut.box_silhouette_xyxy_px, whole.box_silhouette_xyxy_px - [0, 38, 0, 38])
    assert cut.silhouette(camera.height, camera.width).sum() == cut.visible_px


def measure_visibility_of(scene, instance):
    with SceneRenderer(scene) as renderer:
        return next(v for v in measure_visibility(renderer) if v.instance == instance)
