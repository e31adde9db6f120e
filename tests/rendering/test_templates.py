import subprocess
import sys

import numpy as np
import pytest

from simpick.cli.templates import TemplatesShow
from simpick.errors import ConfigError, OutputError
from simpick.rendering import TemplateConfig, load_templates, render_part_views, template_sheet, view_directions
from simpick.rendering import templates as templates_module
from simpick.rendering.templates import template_path

SMALL = TemplateConfig(views=42, size_px=48)


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("SIMPICK_CACHE", str(tmp_path))
    return tmp_path


def test_view_directions_are_even_unit_vectors_from_the_top_down():
    for views, spacing_deg in ((42, 32.0), (162, 17.0), (642, 8.7)):
        d = view_directions(views)
        assert d.shape == (views, 3)
        np.testing.assert_allclose(np.linalg.norm(d, axis=-1), 1.0)
        nearest = np.sort(d @ d.T, axis=-1)[:, -2]
        assert np.degrees(np.arccos(nearest.min())) <= spacing_deg + 3
        assert (np.diff(d[:, 2]) <= 1e-6).all()


def test_an_unknown_number_of_views_lists_the_valid_ones():
    with pytest.raises(ConfigError, match=r"views must be one of 12, 42, 162, 642, 2562, got 100"):
        TemplateConfig(views=100)


@pytest.mark.render
def test_templates_show_the_whole_part_in_the_middle(wedge, cache):
    templates = load_templates(wedge, SMALL)
    border = np.concatenate([templates.masks[:, [0, -1]], templates.masks[:, :, [0, -1]].swapaxes(1, 2)], axis=1)
    assert not border.any()
    assert templates.masks.sum(axis=(1, 2)).min() > 30
    assert (templates.rgb[templates.masks].max(axis=-1) > 20).mean() > 0.95, "a dark part must be exposed"
    assert templates.rgb[~templates.masks].mean() < 5


@pytest.mark.render
def test_the_cache_returns_the_same_bits_without_rendering(wedge, cache, monkeypatch):
    calls = []
    first = load_templates(wedge, SMALL, progress=lambda done, total: calls.append((done, total)))
    assert calls[-1] == (42, 42)
    monkeypatch.setattr(templates_module, "render_templates", lambda *a, **k: pytest.fail("rendered again"))
    second = load_templates(wedge, SMALL)
    np.testing.assert_array_equal(first.rgb, second.rgb)
    np.testing.assert_array_equal(first.depth_m, second.depth_m)


@pytest.mark.render
@pytest.mark.parametrize("damage", ["truncated", "garbage", "flipped"])
def test_a_damaged_cache_file_is_made_again(wedge, cache, damage):
    first = load_templates(wedge, SMALL)
    path = template_path(wedge, SMALL)
    content = bytearray(path.read_bytes())
    if damage == "flipped":
        content[len(content) // 2] ^= 0xFF
    path.write_bytes({"truncated": content[: len(content) // 3], "garbage": b"no zip"}.get(damage, content))
    np.testing.assert_array_equal(load_templates(wedge, SMALL).depth_m, first.depth_m)
    np.testing.assert_array_equal(load_templates(wedge, SMALL).rgb, first.rgb)


@pytest.mark.render
def test_depth_survives_the_cache_to_a_few_micrometres(wedge, cache):
    templates = load_templates(wedge, SMALL)
    exact = render_part_views(wedge, templates.Ts_camera_part, templates.camera, rgb=False)
    np.testing.assert_array_equal(templates.masks, exact.masks)
    assert np.abs(templates.depth_m - exact.depth_m).max() < 3e-6


@pytest.mark.render
def test_turning_the_image_equals_turning_the_camera(wedge, cache):
    templates = load_templates(wedge, TemplateConfig(views=42, size_px=128))
    views, angles = np.array([3, 17, 30]), np.radians([30.0, 100.0, -75.0])
    rgb, masks, Ts_camera_part = templates.turned(views, angles)
    rendered = render_part_views(wedge, Ts_camera_part, templates.camera)
    assert rendered.rgb is not None
    for k in range(3):
        union = (masks[k] | rendered.masks[k]).sum()
        assert (masks[k] & rendered.masks[k]).sum() > 0.97 * union
        inside = masks[k] & rendered.masks[k]
        assert np.abs(rgb[k].astype(int) - rendered.rgb[k])[inside].mean() < 4


@pytest.mark.render
def test_several_processes_make_the_same_templates_at_once(cache):
    code = (
        "from simpick.assets.library import get_part\n"
        "from simpick.rendering import TemplateConfig, load_templates\n"
        "t = load_templates(get_part('hex_nut'), TemplateConfig(views=12, size_px=32))\n"
        "print(int(t.rgb.astype(int).sum()), float(t.depth_m.sum()))"
    )
    runs = [subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) for _ in range(2)]
    results = [run.communicate()[0] for run in runs]
    assert all(run.returncode == 0 for run in runs)
    assert results[0] == results[1] and results[0]
    assert [p.suffix for p in cache.rglob("*.*")] == [".zip"], "no temporary file may be left"


@pytest.mark.render
def test_the_sheet_has_a_row_of_turned_views_below_all_views(wedge, cache):
    sheet = template_sheet(load_templates(wedge, SMALL), columns=14, cell_px=32)
    assert sheet.shape == (4 * 32, 14 * 32, 3)
    with pytest.raises(ConfigError, match=r"columns >= 1 and cell_px >= 8, got 0 and 96"):
        template_sheet(load_templates(wedge, SMALL), columns=0)


@pytest.mark.render
def test_the_command_writes_the_sheet_and_replaces_nothing_unasked(cache, capsys):
    out = cache / "sheet.png"
    assert TemplatesShow("hex_nut", out, views=12, size_px=32).run() == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    assert "12 templates of hex_nut" in capsys.readouterr().out
    with pytest.raises(OutputError, match=r"sheet.png exists already. Choose another file with --out, or pass --overw"):
        TemplatesShow("hex_nut", out, views=12, size_px=32).run()
    with pytest.raises(ConfigError, match=r"out must be a \.png file, got 'sheet\.jpg'"):
        TemplatesShow("hex_nut", out.with_name("sheet.jpg").relative_to(cache)).run()
