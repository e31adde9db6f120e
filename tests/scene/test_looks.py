import numpy as np
import pytest

from simpick.rendering import SceneRenderer
from simpick.scene import SceneConfig, build_scene
from simpick.scene.randomization import RANDOMIZATIONS, draw_look
from simpick.scene.textures import value_noise


def test_without_randomization_every_seed_looks_alike():
    looks = [draw_look(RANDOMIZATIONS["none"], 2, np.random.default_rng(seed)) for seed in (0, 1)]
    for one, other in zip(looks[0].lamps, looks[1].lamps, strict=True):
        np.testing.assert_array_equal(one.position_m, other.position_m)
        np.testing.assert_array_equal(one.rgb, other.rgb)
    assert looks[0].ambient == looks[1].ambient
    np.testing.assert_allclose(looks[0].T_camera_jittered, np.eye(4), atol=1e-12)
    assert all(tint.recolour((0.2, 0.4, 0.6)) == pytest.approx((0.2, 0.4, 0.6)) for tint in looks[0].tints)


def test_looks_stay_within_the_ranges_of_their_preset():
    strong = RANDOMIZATIONS["strong"]
    looks = [draw_look(strong, 3, np.random.default_rng(seed)) for seed in range(60)]
    assert {len(look.lamps) for look in looks} == {1, 2, 3, 4}
    assert all(strong.ambient[0] <= look.ambient <= strong.ambient[1] for look in looks)
    shifts = np.array([look.T_camera_jittered[:3, 3] for look in looks])
    assert 0.5 * strong.camera_shift_m < np.abs(shifts).max() <= strong.camera_shift_m
    cosines = [(np.trace(look.T_camera_jittered[:3, :3]) - 1) / 2 for look in looks]
    turns = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    assert 0.5 * strong.camera_turn_deg < turns.max() <= strong.camera_turn_deg + 1e-6


def test_textures_tile_without_seams():
    noise = value_noise(np.random.default_rng(0), 256)
    inner = np.abs(np.diff(noise, axis=0)).max()
    assert np.abs(noise[0] - noise[-1]).max() <= inner
    assert np.abs(noise[:, 0] - noise[:, -1]).max() <= np.abs(np.diff(noise, axis=1)).max()


@pytest.mark.render
@pytest.mark.parametrize("preset", ["none", "default", "strong"])
def test_the_overhead_image_is_well_exposed(preset):
    scene = build_scene(SceneConfig(("hex_nut", "pipe_tee"), 6, robot=None, randomization=preset), seed=4)
    with SceneRenderer(scene) as renderer:
        image = renderer.capture("overhead", depth=False, instances=False).rgb
    assert 40 < image.mean() < 180
    assert (image.min(axis=-1) > 250).mean() < 0.02
