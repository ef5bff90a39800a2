"""The package from Python: imports without side effects, scenes from dictionaries, callbacks, results as arrays."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import periporo
from periporo.core.points.material import UpdatesFailed
from periporo.core.points.probes import Probes
from periporo.core.watch.watchdog import WatchdogError
from periporo.io.output import checkpoint
from periporo.materials.elastic import Elastic


def test_importing_periporo_imports_nothing_else_and_touches_no_file(tmp_path):
    probe = (
        "import sys, os; import periporo, periporo.materials\n"
        "loaded = {m.split('.')[0] for m in sys.modules}\n"
        "heavy = {'numpy', 'numba', 'mpi4py', 'h5py', 'pydantic', 'yaml', 'rich'} & loaded\n"
        "assert not heavy, heavy\n"
        "assert not os.path.exists(os.environ['PERIPORO_CACHE'])\n"
        "assert set(periporo.__all__) <= set(dir(periporo))\n"
        "assert set(periporo.materials.__all__) <= set(dir(periporo.materials))\n"
        "from periporo import InputError, Simulation, open_results, run\n"
    )
    environment = {"PERIPORO_CACHE": str(tmp_path / "cache"), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", probe], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr


def test_what_does_not_exist_is_an_attribute_error():
    with pytest.raises(AttributeError, match="simulate"):
        _ = periporo.simulate


def test_a_scene_from_a_dictionary_moves_in_memory_and_calls_back(scene_of, tmp_path, monkeypatch):
    """Free fall for 1 ms: the mean velocity is g t."""
    monkeypatch.chdir(tmp_path)
    scene = scene_of(contacts=[])
    scene["bodies"][0]["shape"]["lower"] = np.array(scene["bodies"][0]["shape"]["lower"])
    sim = periporo.Simulation.from_scene(scene)
    seen = []
    sim.call_every(3, lambda s: seen.append((s.step_number, s.time)))
    sim.run()
    steps = [step for step, _ in seen]
    assert len(steps) > 3 and steps == list(range(3, steps[-1] + 1, 3)) and sim.step_number - steps[-1] < 3
    velocity = sim.particles.velocity[: sim.particles.owned]
    np.testing.assert_allclose(velocity, np.tile([0.0, -9.81 * sim.time], (80, 1)), rtol=1e-9, atol=1e-12)
    assert list(tmp_path.iterdir()) == []


def test_run_writes_results_and_calls_back(scene_of, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    kinetic = {}
    path = periporo.run(
        scene_of(output={"history_interval": 5}), "fall.vtkhdf", quiet=True,
        callbacks=[(5, lambda sim: kinetic.update({sim.step_number: sim.ledger.kinetic()}))],
    )  # fmt: skip
    assert str(path) == "fall.vtkhdf" and capsys.readouterr().out == ""
    with periporo.open_results(path) as results:
        recorded = dict(zip(results.history("step"), results.history("kinetic_energy"), strict=True))
    assert kinetic and all(recorded[step] == value for step, value in kinetic.items())


def test_checkpoints_of_what_is_taken_back_make_way(scene_of, tmp_path, monkeypatch):
    """A run that is resumed goes on from where the watchdog went back to."""
    monkeypatch.chdir(tmp_path)
    spoilt, file = [], Path("fall.vtkhdf")

    def act(sim):
        if sim.step_number == 10:
            os.kill(os.getpid(), signal.SIGTERM if spoilt else signal.SIGUSR1)
        if sim.step_number == 15:
            spoilt.append(checkpoint.existing(file))
            sim.particles.velocity[5, 0] = np.nan

    scene = scene_of(stages=[{"name": "fall", "type": "dynamics", "duration": 1e-2}])
    periporo.run(scene, file, quiet=True, callbacks=[(1, act)])
    assert [[path.name[-5:] for path in paths] for paths in spoilt] == [["10.h5"]]
    assert [path.name[-5:] for path in checkpoint.existing(file)] == ["10.h5", "00.h5"]


@pytest.mark.parametrize("interval", [0, -1, 2.5, True])
def test_a_callback_needs_a_number_of_steps(scene_of, interval):
    sim = periporo.Simulation.from_scene(scene_of())
    with pytest.raises(ValueError, match="every 1, 2, 3"):
        sim.call_every(interval, print)


def test_run_says_what_it_needs(scene_of, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="file='name.vtkhdf'"):
        periporo.run(scene_of())
    with pytest.raises(periporo.InputError, match="did you mean 'horizon'"):
        periporo.run(scene_of(horizn=2.0), "a.vtkhdf")
    with pytest.raises(periporo.InputError, match="no such file"):
        periporo.run("nowhere.yaml")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_dictionary_goes_on(scene_of, tmp_path, monkeypatch, capsys):
    """Stopped by the clock at once, then resumed to the bits of the run that was not stopped."""
    monkeypatch.chdir(tmp_path)
    periporo.run(scene_of(), "whole.vtkhdf", quiet=True)
    periporo.run(scene_of(), "parts.vtkhdf", walltime=1e-3)
    assert "go on with: run(..., resume=True)" in capsys.readouterr().out
    periporo.run(scene_of(), "parts.vtkhdf", resume=True)
    periporo.run(scene_of(), "parts.vtkhdf", resume=True)
    assert "has finished" in capsys.readouterr().out
    with periporo.open_results("whole.vtkhdf") as whole, periporo.open_results("parts.vtkhdf") as parts:
        np.testing.assert_array_equal(whole.positions(), parts.positions())


def test_a_run_has_the_watchdog(scene_of, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def break_it(sim):
        sim.particles.velocity[0] = np.nan

    with pytest.raises(WatchdogError, match="point 0 .* is not a number"):
        periporo.run(scene_of(), "broken.vtkhdf", quiet=True, callbacks=[(3, break_it)])


def test_updates_that_fail_are_told_at_the_end(scene_of, tmp_path, monkeypatch, capsys):
    advance, failures = Elastic.compute_stress, [2, 1]

    def forget(self, stress, strain_increment, state, dt):
        advance(self, stress, strain_increment, state, dt)
        if failures and strain_increment.any():
            raise UpdatesFailed(np.arange(failures.pop()))

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Elastic, "compute_stress", forget)
    with periporo.open_results(periporo.run(scene_of(), "fall.h5")) as results:
        assert results.attributes["failed_updates"] == 3
    assert "3 updates of laws failed: those rows kept their stress" in capsys.readouterr().out
    with periporo.open_results(periporo.run(scene_of(), "sound.h5")) as results:
        assert results.attributes["failed_updates"] == 0
    assert "of laws failed" not in capsys.readouterr().out


def test_results_as_xarray(scene_of, tmp_path, monkeypatch):
    pytest.importorskip("xarray")
    monkeypatch.chdir(tmp_path)
    path = periporo.run(scene_of(), "fall.vtkhdf", quiet=True)
    with periporo.open_results(path) as results:
        data = results.to_xarray()
        np.testing.assert_array_equal(data["stress"].sel(component="yy").isel(time=-1), results.field("stress")[:, 1])
        assert data["position"].attrs["units"] == "m" and data.sizes["id"] == 80


@pytest.mark.parametrize("dimension", [2, 3])
def test_monitored_points_are_recorded(scene_of, tmp_path, monkeypatch, dimension):
    """Free fall from speed v: displacement v t - g t^2/2 of the two points nearest to two places."""
    monkeypatch.chdir(tmp_path)
    counts, start = ((10, 8), (2.0, -1.0)) if dimension == 2 else ((5, 4, 4), (2.0, 0.5, -1.0))
    scene = scene_of(dimension, counts, contacts=[], output={"history_interval": 1})
    scene["bodies"][0]["velocity"] = start
    top = np.array(scene["bodies"][0]["shape"]["upper"])
    scene["monitor"] = {"points": [np.zeros(dimension), top]}
    with periporo.open_results(periporo.run(scene, "fall.vtkhdf", quiet=True)) as results:
        t = results.history("time")
        gravity = np.zeros(dimension)
        gravity[-1] = -9.81
        for name in ("point_0", "point_1"):
            for axis, v, g in zip("xyz", start, gravity, strict=False):
                np.testing.assert_allclose(results.history(f"{name}_displacement_{axis}"), v * t + g * t**2 / 2,
                                           rtol=1e-9, atol=1e-12)  # fmt: skip
                np.testing.assert_allclose(results.history(f"{name}_velocity_{axis}"), v + g * t, rtol=1e-9)
        assert results.unit("point_1_velocity_x") == "m/s" and "point_2_velocity_x" not in results.history_names


def test_the_nearest_point_is_chosen_and_of_equals_the_first(scene_of):
    sim = periporo.Simulation.from_scene(scene_of())
    p = sim.particles
    chosen = [23, 41, 79]
    probes = Probes([p.position[k] + 0.001 for k in chosen], p, sim.comm)
    assert probes.ids == [p.id[k] for k in chosen]
    between = (p.position[0] + p.position[9]) / 2  # in the middle of four points
    assert Probes([between], p, sim.comm).ids == [0]


def test_points_in_wet_soil_tell_their_pressure(scene_of):
    water = {"water_table": 0.05, "porosity": 0.4}
    sim = periporo.Simulation.from_scene(scene_of() | {"pore_water": water})
    p = sim.particles
    probes = Probes(p.position[[3, 7]], p, sim.comm)
    found = probes.entries(p)
    assert list(found) == list(probes.units) and probes.units["point_1_pore_pressure"] == "Pa"
    for k, i in enumerate((3, 7)):
        assert found[f"point_{k}_pore_pressure"] == pytest.approx(9810.0 * max(0.05 - p.position[i, 1], 0.0))
        assert found[f"point_{k}_velocity_y"] == p.velocity[i, 1]
