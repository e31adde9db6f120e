import json

import pytest

from simpick.config import from_json
from simpick.errors import ConfigError, SceneError, UnknownNameError
from simpick.scene import BinConfig, CameraConfig, PhysicsConfig, SceneConfig, build_scene


@pytest.mark.parametrize("count", [0, -1, 51, 500])
def test_a_bin_holds_1_to_50_parts(count):
    with pytest.raises(ConfigError, match=f"count must be between 1 and 50, got {count}"):
        SceneConfig(count=count)


def test_no_parts_and_repeated_parts_are_refused():
    with pytest.raises(ConfigError, match=r"parts must be (of length at least 1|a tuple)"):
        SceneConfig(parts=())
    with pytest.raises(ConfigError, match="parts must be distinct, got hex_nut, hex_nut; name each part once"):
        SceneConfig(parts=("hex_nut", "hex_nut"))


def test_unknown_names_list_those_that_exist():
    with pytest.raises(UnknownNameError, match=r"no gripper named 'hand'. Valid: jaw, suction\."):
        SceneConfig(gripper="hand")
    with pytest.raises(UnknownNameError, match=r"named 'wild'. Valid: default, none, photo, strong\."):
        SceneConfig(randomization="wild")
    with pytest.raises(UnknownNameError, match=r"no robot named 'kuka'. Valid: .*ur5e"):
        SceneConfig(robot="kuka")


def test_millimetres_in_place_of_metres_are_noticed():
    with pytest.raises(ConfigError, match=r"length_m must be between 0\.05 and 1, got 400\.0 \(give metres, not mill"):
        BinConfig(length_m=400.0)


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: BinConfig(wall_m=0.1), "wall_m must be between 0.002 and 0.05, got 0.1"),
        (lambda: CameraConfig(width_px=0), "width_px must be between 16 and 4096, got 0"),
        (lambda: CameraConfig(fovy_deg=180.0), "fovy_deg must be between 5 and 120, got 180.0"),
        (lambda: SceneConfig(overhead_height_m=0.1), "overhead_height_m must be between 0.42 .* and 3.0 m, got 0.1"),
        (lambda: PhysicsConfig(timestep_s=0.02), "timestep_s must be between 0.0001 and 0.004, got 0.02"),
        (lambda: PhysicsConfig(impratio=0.5), "impratio must be at least 1, got 0.5"),
        (lambda: PhysicsConfig(part_friction=0.0), "part_friction must be between 0.05 and 2, got 0.0"),
    ],
)
def test_values_out_of_range_are_named_with_their_range(make, text):
    with pytest.raises(ConfigError, match=text):
        make()


def test_a_part_larger_than_the_bin_is_refused_before_anything_is_simulated():
    config = SceneConfig(parts=("connecting_rod",), bin=BinConfig(0.08, 0.06, 0.05))
    with pytest.raises(
        SceneError, match=r"part 'connecting_rod' \(\d+ x \d+ x \d+ mm\) must fit into the bin \(80 x 60 x"
    ):
        build_scene(config, seed=0)


def test_a_negative_seed_is_refused():
    with pytest.raises(ConfigError, match="seed must not be negative, got -1"):
        build_scene(SceneConfig(), seed=-1)


def test_a_configuration_survives_json():
    config = SceneConfig(("hex_nut", "hex_bolt"), 7, None, "suction", BinConfig(0.3, 0.2, 0.1), randomization="strong")
    assert from_json(SceneConfig, json.loads(json.dumps(config.to_json())), complete=True) == config
    with pytest.raises(ConfigError, match="colour is unknown, valid: parts, count"):
        from_json(SceneConfig, {**config.to_json(), "colour": "red"})
