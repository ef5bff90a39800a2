"""Points that leave the domain of a scene: gone, counted, and missing nowhere in the ledger."""

import h5py
import numpy as np
import pytest

import periporo
from periporo.core.points.material import UpdatesFailed
from periporo.io.input.load import parse_scene
from periporo.materials.elastic import Elastic


@pytest.fixture
def table(scene_of):
    """A block that slides off a table of 0.1 m height, and falls beside it."""
    scene = scene_of(counts=(10, 4), contacts=[{"type": "box", "lower": [-0.05, -0.1], "upper": [0.02, 0.0],
                                                "friction": 0.0}])  # fmt: skip
    scene["bodies"][0]["velocity"] = [0.6, 0.0]
    scene["stages"][0]["duration"] = 0.05
    scene["monitor"] = {"points": [[0.045, 0.005]]}
    return scene | {"domain": {"upper": [0.06, None]}, "output": {"interval": 0.01, "history_interval": 20}}


def test_what_leaves_is_counted_and_the_ledger_closes(table, tmp_path):
    with periporo.open_results(periporo.run(table, tmp_path / "a.vtkhdf", quiet=True)) as results:
        count, energy = results.history("departed_points"), results.history("departed_energy")
        assert count[0] == 0 and 6 < count[-1] < 40 and (np.diff(count) >= 0).all()
        assert len(results.ids(0)) == 40 and len(results.ids()) == 40 - count[-1]
        assert results.positions()[:, 0].max() < 0.06 + 10 * 0.7 * results.history("dt").max()
        mass = 1760.0 * 1e-4
        assert energy[-1] > 0.4 * count[-1] * mass * 0.5 * 0.6**2
        assert results.unit("departed_energy") == "J"
        unexplained = results.history("energy_residual") - results.history("integration_term")
        assert np.abs(unexplained).max() < 1e-12 * results.history("kinetic_energy").max()
        gained = results.history("kinetic_energy") + energy - results.history("kinetic_energy")[0]
        works = (results.history("external_work") - results.history("internal_energy")
                 - results.history("contact_energy") - results.history("friction_dissipation"))  # fmt: skip
        assert gained - works == pytest.approx(results.history("integration_term"), rel=0, abs=1e-11 * gained.max())
        probe = results.history("point_0_velocity_x")
        assert probe[0] == 0.6 and np.isnan(probe[-1])


def test_a_run_goes_on_when_all_have_left_and_its_words_work(table, tmp_path, call):
    """Falls out of a domain without a floor; what is left to see is an empty place of the size of the start."""
    scene = table | {"contacts": [], "domain": {"lower": [None, -0.02]}, "gravity": [0.0, -200.0]}
    scene |= {"stages": [{"name": "fall", "type": "dynamics", "duration": 0.1}]}
    scene.pop("monitor")
    with periporo.open_results(periporo.run(scene, tmp_path / "a.vtkhdf", quiet=True, pictures=True)) as results:
        assert results.history("departed_points")[-1] == 40 and len(results.ids()) == 0 and len(results.ids(0)) == 40
        assert np.isnan(results.history("height")[-1]) and np.isfinite(results.history("height")[0])
    assert (tmp_path / "a_deposit.png").exists()
    for words in (["info"], ["plot", "--animate"], ["export"]):
        assert call(words[0], "a.vtkhdf", *words[1:])[0] == 0, words


def test_a_domain_that_nothing_leaves_changes_no_bit(table, tmp_path):
    table["stages"][0]["duration"] = 0.01
    without = {key: value for key, value in table.items() if key != "domain"}
    for name, scene in (("a", table), ("b", without)):
        periporo.run(scene, tmp_path / f"{name}.vtkhdf", quiet=True)
    with h5py.File(tmp_path / "a.vtkhdf") as a, h5py.File(tmp_path / "b.vtkhdf") as b:
        assert np.array_equal(a["VTKHDF/Points"], b["VTKHDF/Points"])
        assert set(a["History"]) - set(b["History"]) == {"departed_points", "departed_energy"}


def test_a_resumed_run_remembers_who_left(table, tmp_path):
    whole, parts = tmp_path / "whole.vtkhdf", tmp_path / "parts.vtkhdf"
    periporo.run(table, whole, quiet=True)

    def stop(sim):
        if sim.departures.count > 3:
            sim.guards[1].signals.wishes |= 2

    periporo.run(table, parts, quiet=True, callbacks=[(1, stop)])
    periporo.run(table, parts, quiet=True, resume=True)
    with h5py.File(whole) as a, h5py.File(parts) as b:
        for name in ("VTKHDF/Points", "VTKHDF/PointData/id", "History/departed_energy", "History/energy_residual"):
            assert np.array_equal(a[name], b[name]), name


def test_bodies_must_begin_inside(table):
    table["domain"] = {"lower": [-0.04, None], "upper": [None, 0.039]}
    with pytest.raises(periporo.InputError, match=r"domain.lower: the body 'block' reaches to -0.05 along x") as error:
        parse_scene(table)
    assert "domain.upper: the body 'block' reaches to 0.04 along y" in str(error.value)


@pytest.mark.parametrize("scheme", ["point_state", "bond_projected"])
@pytest.mark.parametrize("fate", ["keep", "remove"])
def test_points_whose_law_fails_stay_or_are_taken_away(scene_of, tmp_path, monkeypatch, fate, scheme):
    """Rows 3 and 4 fail in step 7: a point each, or both ends of two bonds; the ledger closes without them."""
    advance, calls = Elastic.compute_stress, []

    def forget(self, stress, strain_increment, state, dt):
        advance(self, stress, strain_increment, state, dt)
        calls.append(dt)
        if len(calls) == 7:
            raise UpdatesFailed([3, 4])

    monkeypatch.setattr(Elastic, "compute_stress", forget)
    scene = scene_of(counts=(6, 4), failed_points=fate, correspondence=scheme, output={"history_interval": 5})
    scene["bodies"][0]["velocity"] = [0.5, 0.0]
    with periporo.open_results(periporo.run(scene, tmp_path / "a.vtkhdf", quiet=True)) as results:
        assert results.attributes["failed_updates"] == 2 and len(results.ids(0)) == 24
        gone = set(results.ids(0)) - set(results.ids())
        if fate == "keep":
            assert not gone and "departed_points" not in results.history_names
            return
        assert results.history("departed_points")[-1] == len(gone)
        assert len(gone) in ((2,) if scheme == "point_state" else (3, 4))
        energy = results.history("departed_energy")[-1]
        assert energy == pytest.approx(len(gone) * 1760.0 * 1e-4 * 0.5 * 0.5**2, rel=0.01)
        unexplained = results.history("energy_residual") - results.history("integration_term")
        assert np.abs(unexplained).max() < 1e-11 * results.history("kinetic_energy").max()
