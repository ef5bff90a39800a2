"""The study of column collapse at small size: its cases, one of them run to rest, and what is measured of it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.column_collapse_study import STUDY as FILE
from benchmarks.library import runs
from benchmarks.library.study import cases, laws, table
from periporo.io.input.load import parse_scene

STUDY = cases.Study(FILE)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """The lowest granular column on a coarse grid, at rest."""
    study = cases.Study(FILE, 0.01)
    case = study.cases[0]
    folder = tmp_path_factory.mktemp("study") / case.name
    assert cases.run(study, case, folder) == 0
    return case, folder


def test_every_case_is_a_valid_scene_with_a_name_of_its_own():
    assert len({case.name for case in STUDY.cases}) == len(STUDY.cases) > 40
    for case in STUDY.cases:
        scene = parse_scene(STUDY.scene(case))
        assert scene.bodies[0].shape.upper == (0.05, case.height) and scene.spacing == case.spacing
        assert scene.contacts[0].friction == case.friction
        assert (scene.pore_water is None) == (case.suction is None)


def test_the_sweeps_are_there():
    dry = {(c.set, c.height, c.friction) for c in STUDY.cases if c.suction is None and c.spacing == 2.5e-3}
    heights = (0.05, 0.1, 0.2)
    assert {("granular", h, 0.5) for h in heights} | {("paper", h, f) for h in heights for f in (0, 0.25, 0.5)} <= dry
    wet = {(c.height, c.suction) for c in STUDY.cases if c.suction is not None}
    assert wet == {(h, s) for h in heights for s in (100, 250, 500, 25e3, 50e3)}


def test_a_spacing_replaces_that_of_all_cases():
    quick = cases.Study(FILE, 5e-3)
    assert {case.spacing for case in quick.cases} == {5e-3}
    assert len(set(quick.cases)) == len(quick.cases)


def test_a_variant_changes_one_thing():
    conical = next(c for c in STUDY.cases if c.variant == "conical")
    plain, changed = STUDY.scene(replace(conical, variant=None)), STUDY.scene(conical)
    assert (plain.pop("influence"), changed.pop("influence")) == ("cubic", "conical")
    assert changed.pop("title") != plain.pop("title")
    assert changed == plain


def test_a_column_comes_to_rest_with_its_energy_accounted_for(finished):
    m = table.measure(*finished)
    assert m.at_rest and m.lost == 0 and m.points == 50
    assert m.ledger < 0.01
    assert 0.3 < m.run_out < 1.5  # 1.2 by Lube et al. 2005; five rows of points spread less
    assert 0.7 < m.height <= 1.0
    assert 0.05 < m.front_stops <= m.ends < 1.0


def test_a_finished_case_is_skipped_and_a_changed_one_starts_anew(finished):
    (case, folder), study = finished, cases.Study(FILE, 0.01)
    before = (folder / cases.RESULT).stat().st_mtime_ns
    assert runs.is_finished(folder / cases.RESULT)
    assert cases.run(study, case, folder) == 0
    assert (folder / cases.RESULT).stat().st_mtime_ns == before
    (folder / cases.SCENE).write_text("title: something else\n")
    assert cases.run(study, case, folder) == 0
    assert (folder / cases.RESULT).stat().st_mtime_ns > before


def test_the_table_is_replaced_and_the_text_stays(finished, tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"text\n\n{table.HEAD}\n|---|\n| old |\n")
    rows = table.lines(dict([finished]))
    assert rows[0].count("|") == rows[1].count("|") == rows[2].count("|")
    table.put_into(page, rows)
    assert page.read_text() == "text\n\n" + "\n".join(rows) + "\n"
    with pytest.raises(ValueError, match="no table"):
        (tmp_path / "empty.md").write_text("text\n")
        table.put_into(tmp_path / "empty.md", rows)


def test_scatter_is_that_of_runs_that_differ_by_the_seed(finished):
    case, folder = finished
    assert table.scatter_lines({case: folder}) == []
    row = table.scatter_lines({replace(case, variant=f"seed {k}"): folder for k in (1, 2)})[-1]
    m = table.measure(case, folder)
    assert row == f"| {case.name} | 2 | {m.run_out:.2f} ± 0.00 | {m.height:.2f} ± 0.00 |"


def test_laws_of_experiments():
    a = np.array([1.0, 2.0, 4.0])
    assert laws.lube_run_out(a) == pytest.approx([1.20, 2.40, 4.79], abs=0.005)
    assert laws.lube_height(a) == pytest.approx([1.00, 1.32, 1.74], abs=0.005)
    assert laws.lube_time(a * 0.05) == pytest.approx([0.236, 0.333, 0.471], abs=0.001)
    assert laws.lube_axisymmetric_run_out(a) == pytest.approx([1.24, 2.26, 3.20], abs=0.005)
    assert laws.lube_axisymmetric_height([0.5, 64.0]) == pytest.approx([0.5, 1.76])
