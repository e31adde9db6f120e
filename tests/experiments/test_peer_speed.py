"""Other packages' environments: what is measured, and what is reported where they are missing or fail."""

import json
from pathlib import Path

import pytest

from simpick.experiments import peer_speed


def test_a_package_that_is_missing_is_named_with_how_to_install_it() -> None:
    for peer in peer_speed.measure_peers():
        if peer.per_s is None:
            package = peer.package.split()[0]
            assert f"pip install {package}" in str(peer.missing) or "does not run with MuJoCo" in str(peer.missing)


def test_a_python_that_gives_no_figures_is_named(tmp_path: Path) -> None:
    for peer in peer_speed.measure_peers(tmp_path / "python"):
        assert peer.per_s is None
        assert f"{tmp_path / 'python'} gave no figures" in str(peer.missing)


def test_an_environment_that_fails_is_reported_with_its_error(monkeypatch, capsys) -> None:
    def broken() -> None:
        raise AssertionError("joint limits")

    monkeypatch.setattr(peer_speed, "_ENVIRONMENTS", (("Broken", "numpy", broken),))
    peer_speed.main("Broken")
    found = json.loads(capsys.readouterr().out)
    assert "AssertionError joint limits" in found["missing"] and "--peer-python" in found["missing"]


def test_the_limit_is_what_mujoco_s_steps_take(monkeypatch) -> None:
    import mujoco

    for name in ("mj_step", "mj_step1", "mj_step2"):  # Restores what is timed.
        monkeypatch.setattr(mujoco, name, getattr(mujoco, name))
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)

    def step() -> None:
        mujoco.mj_step(model, data)
        sum(range(20000))

    found = peer_speed._measured(step)
    assert found["limit_per_s"] > 3 * found["per_s"]
    assert data.time == pytest.approx((peer_speed.STEPS + 1) * model.opt.timestep)
