"""A few of the scenes of the benchmark `random_scenes`, of all kinds of contact."""

import pytest

from benchmarks import random_scenes
from benchmarks.library.random_scene import LAWS, draw


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    """Folders in which the example plugin is found as if it were installed."""
    folder = tmp_path_factory.mktemp("plugin")
    random_scenes.with_plugin(folder)
    return folder, random_scenes.PLUGIN


@pytest.mark.parametrize("number", [102, 120, 157, 185])
def test_a_random_scene_gains_no_energy_and_passes_no_wall(number, tmp_path, plugin, monkeypatch):
    """102, 120, 157: bodies that see the far side of others; 185: an elastic body dented by a stiff disc."""
    for folder in plugin:
        monkeypatch.syspath_prepend(str(folder))
    row = random_scenes.judge(number, tmp_path)
    assert row["verdict"] == "done", row
    assert float(row["gain"]) < 5e-3 and row["steps"] > 100


def test_draws_are_reproducible_and_spread(tmp_path):
    scenes = [draw(k, tmp_path) for k in range(120)]
    assert draw(17, tmp_path) == scenes[17]
    assert {law for s in scenes for law in s["materials"]} == set(LAWS)
    kinds = {c["type"] for s in scenes for c in s["contacts"]}
    assert kinds == {"bodies", "plane", "box", "disc", "cylinder", "polyline", "terrain", "short_range_published"}
    assert {len(s["bodies"]) for s in scenes} == {2, 3, 4, 5}
    assert any("velocity" in c and "stages" in c for s in scenes for c in s["contacts"])
