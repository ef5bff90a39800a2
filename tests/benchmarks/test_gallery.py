"""The gallery: a small scene is run, drawn and described; the committed page is that of the shipped scenes."""

import pytest

from benchmarks import gallery

SCENE = """# A block falls
# on a floor.
title: Falling block
dimension: 2
spacing: 0.02
gravity: [0, -9.81]
materials:
  soil: {model: elastic, density: 1760, bulk_modulus: 2.5e6, shear_modulus: 1.5e6}
bodies:
  - {name: block, material: soil, shape: {type: box, lower: [0, 0], upper: [0.2, 0.1]}}
contacts:
  - {type: plane, point: [0, 0], normal: [0, 1], friction: 0.5}
stages:
  - {name: fall, type: dynamics, duration: 0.01}
output: {interval: 0.002}
"""


@pytest.fixture
def scenes(tmp_path, monkeypatch):
    """A gallery of one scene in a folder of its own."""
    scene = tmp_path / "block.yaml"
    scene.write_text(SCENE)
    pictures = tmp_path / "figures" / "gallery"
    for name, value in {"SCENES": [scene], "PICTURES": pictures, "TABLE": pictures / "runs.csv",
                        "PAGE": tmp_path / "gallery.md"}.items():  # fmt: skip
        monkeypatch.setattr(gallery, name, value)
    return tmp_path


def test_a_scene_is_run_once_drawn_and_described(scenes):
    words = ["--folder", str(scenes / "runs")]
    gallery.main(words)
    page, row = (scenes / "gallery.md").read_text(), gallery.read_table()["block"]
    assert "## block" in page and "**Falling block.**\nA block falls\non a floor.\n" in page
    assert row["points"] == "50" and float(row["end_s"]) == pytest.approx(0.01, rel=0.02)
    assert 0.0 < float(row["fastest_m_per_s"]) < 0.1 and float(row["energy_unexplained"]) < 1e-12
    for name in ("block", "block_still"):
        picture = scenes / "figures" / "gallery" / f"{name}.png"
        assert f"](figures/gallery/{name}.png) |" in page and 5_000 < picture.stat().st_size < gallery.LARGE
    result = scenes / "runs" / "block" / "block.vtkhdf"
    before = result.stat().st_mtime_ns
    gallery.main(words)
    assert result.stat().st_mtime_ns == before and (scenes / "gallery.md").read_text() == page


def test_the_committed_page_is_made_of_the_committed_table():
    rows = gallery.read_table()
    assert gallery.PAGE.read_text() == gallery.page(rows), "run `python -m benchmarks gallery --draw`"
    assert set(rows) <= {scene.stem for scene in gallery.SCENES}, "a scene is gone: run `python -m benchmarks gallery`"
    for name in rows:
        for file in (f"{name}.png", f"{name}_still.png"):
            assert (gallery.PICTURES / file).stat().st_size <= gallery.LARGE
