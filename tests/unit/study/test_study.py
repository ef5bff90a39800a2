"""Studies: which variants there are, runs that are kept, the table, and what is refused."""

import csv
from pathlib import Path

import numpy as np
import pytest
import yaml

import periporo
from periporo import InputError
from periporo.core.study import runner
from periporo.core.study.variants import read_study

SCENE = {
    "dimension": 2, "spacing": 0.02, "gravity": [0, -9.81],
    "materials": {"soil": {"model": "elastic", "density": 1760, "bulk_modulus": 2.5e6, "shear_modulus": 1.5e6}},
    "bodies": [{"name": "b", "material": "soil", "velocity": [0.0, 0.0],
                "shape": {"type": "box", "lower": [0, 0], "upper": [0.1, 0.06]}}],
    "stages": [{"name": "fall", "type": "dynamics", "duration": 1e-3}],
}  # fmt: skip
STUDIES = Path(__file__).parents[3] / "configs" / "studies"
PUSH = "bodies.0.velocity.0"


def written(folder, variants, **keys):
    (folder / "fall.yaml").write_text(yaml.safe_dump(SCENE))
    file = folder / "falls.yaml"
    file.write_text(yaml.safe_dump({"scene": "fall.yaml", "variants": variants, **keys}))
    return file


def test_grids_lists_and_named_values(tmp_path):
    kinds = {"stiff": {"materials.soil.bulk_modulus": 9e6, "materials.soil.shear_modulus": 6e6}, "as it is": {}}
    blocks = [{"grid": {PUSH: [0.1, 0.2], "kind": kinds}, "list": {"spacing": [0.01, 0.02], "title": ["a", "b"]}},
              {"grid": {PUSH: [0.5]}}]  # fmt: skip
    study = read_study(written(tmp_path, blocks, change={"bodies.0.velocity.1": -1.0}))
    assert len(study.variants) == 9 and study.factors == [PUSH, "kind", "spacing", "title"]
    assert len({v.name for v in study.variants}) == 9
    stiff = [v.scene for v in study.variants if v.factors.get("kind") == "stiff"]
    assert len(stiff) == 4 and all(s.materials["soil"].parameters["shear_modulus"] == 6e6 for s in stiff)
    assert {(s.spacing, s.title) for s in stiff} == {(0.01, "a"), (0.02, "b")}
    assert all(v.scene.bodies[0].velocity[1] == -1.0 for v in study.variants)


def test_draws_are_the_same_again_and_have_their_distribution(tmp_path):
    keys = {PUSH: {"lognormal": [2.0, 0.5]}, "seed": {"integers": [1, 6]}, "spacing": {"uniform": [0.01, 0.02]}}
    file = written(tmp_path, [{"random": {"count": 200, "seed": 3, "keys": keys}}])
    study = read_study(file)
    push = np.array([v.factors[PUSH] for v in study.variants])
    assert push.mean() == pytest.approx(2.0, rel=0.05) and push.std() == pytest.approx(0.5, rel=0.15)
    assert {v.factors["seed"] for v in study.variants} == set(range(1, 7))
    assert [v.name for v in read_study(file).variants] == [v.name for v in study.variants]


def test_a_study_is_run_and_goes_on_where_it_stopped(tmp_path, monkeypatch):
    """Only what is new is run; a process that dies fails its variant alone; unknown results are refused."""
    said, folder = [], tmp_path / "runs"
    keys = {"results": ["max_max_speed", "last_time"]}

    def study(speeds):
        return periporo.study(written(tmp_path, [{"grid": {PUSH: speeds}}], **keys), folder, cores=1, say=said.append)

    table = study([1.0, 2.0])
    np.testing.assert_allclose(table["max_max_speed"], [1.0, 2.0], rtol=1e-3)
    assert table[PUSH].values.tolist() == [1.0, 2.0] and (table["last_time"] >= 0.999e-3).all()
    first = {f: f.stat().st_mtime_ns for f in folder.glob("*/scene.vtkhdf")}
    assert len(first) == 2
    with monkeypatch.context() as dies:
        begin = runner._Worker.begin

        def begin_and_die(worker, place, variant):
            begin(worker, place, variant)
            if variant.factors[PUSH] == 4.0:
                worker.process.kill()

        dies.setattr(runner._Worker, "begin", begin_and_die)
        table = study([1.0, 2.0, 4.0, 8.0])
    np.testing.assert_allclose(table["max_max_speed"], [1.0, 2.0, np.nan, 8.0], rtol=1e-3)
    assert "2 of 4 variants are finished already" in said and any("failed, see" in text for text in said)
    again = study([1.0, 2.0, 4.0])
    np.testing.assert_allclose(again["max_max_speed"], [1.0, 2.0, 4.0], rtol=1e-3)
    assert all(f.stat().st_mtime_ns == before for f, before in first.items())
    with open(folder / "study.csv") as rows:
        assert [float(row["max_max_speed"]) for row in csv.DictReader(rows)] == again["max_max_speed"].values.tolist()
    assert (folder / "study.html").read_text().count("<img") == 2
    with pytest.raises(InputError, match="no figure 'speed'"):
        periporo.study(written(tmp_path, [{"grid": {PUSH: [1.0]}}], results=["speed"]), folder, run=False)


def test_shipped_studies_can_be_read():
    counts = {file.stem: len(read_study(file).variants) for file in STUDIES.glob("*.yaml")}
    assert counts == {"column_collapse": 84, "cylinder_collapse": 2, "random_field": 20}


@pytest.mark.parametrize(
    "block, words",
    [
        ({}, "at least one of: grid, list, random"),
        ({"list": {"spacing": [1.0, 2.0], "seed": [1]}}, "as many of each"),
        ({"grid": {"materials.sol.density": [1.0]}}, "there is no 'sol'; did you mean"),
        ({"grid": {"spacing": [-1.0]}}, "variant spacing = -1"),
        ({"random": {"count": 2, "keys": {"spacing": {"normal": [1.0, -1.0]}}}}, "deviation > 0"),
    ],
)
def test_bad_studies_are_refused_before_anything_runs(tmp_path, block, words):
    with pytest.raises(InputError, match=words):
        periporo.study(written(tmp_path, [block]), tmp_path / "runs")
    assert not (tmp_path / "runs").exists()
