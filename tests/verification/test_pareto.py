"""The study of run time against error, the benchmark `pareto`, on very few and small runs."""

import numpy as np
import pytest

from benchmarks import pareto
from benchmarks.library import problems
from periporo.io.schema.scene import SceneInput


def runs_of(*rows):
    return [pareto.Run(pareto.Choice(scheme), n, error, seconds) for scheme, n, error, seconds in rows]


def test_front_and_excess():
    runs = runs_of(("a", 1, 0.4, 1.0), ("a", 2, 0.1, 8.0), ("b", 1, 0.5, 1.5), ("b", 2, 0.1, 4.0),
                   ("c", 1, 0.2, 2.0), ("c", 2, 0.15, 30.0))  # fmt: skip
    assert [(r.choice.scheme, r.resolution) for r in pareto.front(runs)] == [("a", 1), ("c", 1), ("b", 2)]
    assert pareto.excess(runs, pareto.Choice("a")) == pytest.approx(2.0**0.5)  # 1 and 8 s in place of 4
    assert pareto.excess(runs, pareto.Choice("c")) == pytest.approx(7.5**0.5)  # 2 s, and 30 in place of 4
    assert pareto.excess(runs, pareto.Choice("b")) == pytest.approx(1.5**0.5)
    assert np.isnan(pareto.excess(runs, pareto.Choice("d")))
    runs += runs_of(("standard", 1, 0.3, 0.5), ("standard", 2, 0.01, 9.0))  # quicker, but it is not stable
    assert pareto.excess(runs, pareto.Choice("a")) == pytest.approx(2.0**0.5)
    assert pareto.excess(runs, pareto.Choice("standard")) == pytest.approx(0.25**0.5)  # nothing beats its second run
    assert [r.choice.scheme for r in pareto.front(pareto.stable(runs))] == ["a", "c", "b"]


def test_what_is_nowhere_worse_and_somewhere_better_dominates():
    one, other, third = np.array([1.0, 2.0]), np.array([1.0, 3.0]), np.array([0.5, 4.0])
    assert pareto.dominates(one, other) and not pareto.dominates(other, one)
    assert not pareto.dominates(one, one) and not pareto.dominates(one, third) and not pareto.dominates(third, one)


def test_defaults_are_those_of_the_program():
    fields = SceneInput.model_fields
    assert fields["horizon"].default == pareto.DEFAULT.m and fields["influence"].default == pareto.DEFAULT.influence
    default = fields["correspondence"].get_default(call_default_factory=True)
    assert {"scheme": default.scheme, **default.options()} == pareto.DEFAULT.correspondence
    assert fields["time_step"].get_default(call_default_factory=True).safety == pareto.DEFAULT.safety


def test_a_sweep_is_written_read_and_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(pareto, "choices", lambda quick: [pareto.Choice("bond_projected"), pareto.DEFAULT])
    monkeypatch.setattr(pareto, "SCHEMES", {k: pareto.SCHEMES[k] for k in ("bond_projected", "point_state, sharpened")})
    pareto.main(["--quick", "--problem", "V6 grid", "--folder", str(tmp_path)])
    runs = pareto.read_runs(tmp_path / "pareto_V6_grid.csv")
    assert [r.resolution for r in runs] == [6, 8, 6, 8] and all(r.seconds > 0.0 for r in runs)
    errors = {(r.choice.scheme, r.resolution): r.error for r in runs}
    assert errors["bond_projected", 8] < errors["bond_projected", 6] < 0.6
    assert errors["point_state, sharpened", 8] < 0.3 * errors["bond_projected", 8]
    table = (tmp_path / "pareto.md").read_text()
    assert "| V6 grid | 4 | " in table and "| point_state, sharpened | cubic | 2.2 | 0.8 |" in table
    assert (tmp_path / "pareto.png").stat().st_size > 10_000


def test_errors_of_problems():
    assert 0.02 < problems.wave_error(10, pareto.Choice("bond_projected")) < 0.06
    assert problems.wave_error(10, pareto.DEFAULT) < 0.006
    one = np.stack([np.linspace(0.0, 2.0, 200), np.linspace(0.0, 1.0, 200)])
    assert problems.distance(one, one + np.array([[0.3], [0.4]])) == pytest.approx(0.5)
    true, locked = (problems.footing_error(8, c) for c in (pareto.DEFAULT, pareto.Choice("bond_projected")))
    assert true < 0.06 and locked > 0.2


def test_what_takes_long_is_run_by_all_schemes_and_around_the_default():
    plan = pareto.flow_plan((10, 14), 20)
    assert {c.scheme for n, c in plan if n == 10} == set(pareto.SCHEMES)
    assert sum(c == pareto.DEFAULT for _, c in plan) == 3 and (20, pareto.Choice("sub_horizon")) not in plan
    assert {c.m for _, c in plan} == {1.8, 2.2, 3.0} and len(plan) == len(set(plan))


def test_where_nothing_flows_the_default_stands_for_what_is_not_regular():
    uneven = pareto.Choice(pareto.UNEVEN)
    assert pareto.twin(uneven, "V7") == pareto.DEFAULT and pareto.twin(uneven, "footing") == uneven
    assert set(pareto.PROBLEMS) > set(pareto.ELASTIC)
