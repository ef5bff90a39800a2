"""Prescribed displacements and tractions of a scene."""

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.loads.boundary import DisplacementHistory, Traction, VelocityHistory
from periporo.core.scene.boundaries import build_boundary
from periporo.errors import InputError
from periporo.io.geometry.lattice import build_lattices
from periporo.io.input.load import parse_scene

TOP = {"lower": [None, 0.06]}


def boundary(scene_of, entry, moving=True, folder=".", **keys):
    scene = parse_scene(scene_of(boundaries={"it": entry}, **keys), folder)
    return build_boundary(scene, "it", build_lattices(scene), moving, MPI.COMM_SELF, {}), scene


def test_histories():
    displacement = DisplacementHistory((0.0, 1.0, 2.0), (0.0, 0.3, 0.1))
    edges = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.2, 20))
    moved = sum(displacement(0.5 * (a + b), b - a) * (b - a) for a, b in zip(edges, edges[1:], strict=False))
    expected = np.interp(edges[[0, -1]], (0.0, 1.0, 2.0), (0.0, 0.3, 0.1))
    assert moved == pytest.approx(expected[1] - expected[0], abs=1e-15)  # whatever the steps
    assert VelocityHistory((0.0, 2.0), (1.0, 3.0))(0.5, 0.1) == pytest.approx(1.5)


def test_prescribed_displacement_is_met_at_every_time(scene_of, started):
    history = {"times": [0.0, 3e-4, 1e-3], "values": [0.0, 2e-5, -1e-5]}
    entry = {"where": TOP, "displacement": {"y": history}}
    stage = {"name": "go", "type": "dynamics", "duration": 1e-3, "boundaries": ["press"]}
    sim = started(scene_of(boundaries={"press": entry}, gravity=[0.0, 0.0], contacts=[], stages=[stage]))
    sim.prescribed_motions = sim.stages[0].prescribed_motions
    for _ in range(25):
        sim.step()
        p = sim.particles
        top = p.initial_position[:, 1] > 0.06
        moved = (p.position - p.initial_position)[top]
        assert moved[:, 1] == pytest.approx(np.interp(sim.time, history["times"], history["values"]), abs=1e-15)
    assert np.ptp(moved[:, 0]) > 0.0  # free along x
    energies = sim.ledger.entries()
    scale = abs(energies["prescribed_work"])
    assert scale > 0.0 and abs(energies["energy_residual"] - energies["integration_term"]) < 1e-12 * scale


def test_relaxation_holds_what_would_move(scene_of):
    for kind in ("velocity", "displacement"):
        value = {"times": [0.0, 1.0], "values": [0.0, 1.0]}
        moving, _ = boundary(scene_of, {"where": TOP, kind: {"x": value}})
        held, _ = boundary(scene_of, {"where": TOP, kind: {"x": value}}, moving=False)
        assert moving.velocities[0](0.5, 0.1) != 0.0 and held.velocities[0](0.5, 0.1) == 0.0


def test_traction_loads_the_outermost_points_once(scene_of):
    load, scene = boundary(scene_of, {"where": TOP, "traction": {"stress": [0.0, -2e3], "side": "y+"}})
    assert isinstance(load, Traction) and len(load.ids) == 10  # 10 x 8 points
    assert load.force.sum(axis=0) == pytest.approx([0.0, -2e3 * 0.1])
    assert load.lever == pytest.approx(np.tile([0.0, 0.005], (10, 1)), abs=1e-15)
    position = np.concatenate([x for _, x, *_ in build_lattices(scene)[0].chunks()])
    assert position[load.ids, 1] == pytest.approx(0.075)
    side, _ = boundary(scene_of, {"where": TOP, "traction": {"stress": [1e3, 0.0], "side": "x-"}})
    assert len(side.ids) == 2 and position[side.ids, 0] == pytest.approx(-0.045)


@pytest.mark.parametrize(("side", "axis", "area"), [("x+", 0, 0.08), ("y-", 1, 0.08), ("z+", 2, np.pi * 0.04**2)])
def test_traction_on_rings_of_points_loads_the_whole_of_their_section(scene_of, side, axis, area):
    shape = {"type": "cylinder", "base": [0.0, 0.0, 0.0], "axis": "z", "radius": 0.04, "height": 1.0}
    stress = [1e3 * (a == axis) for a in range(3)]
    load, scene = boundary(
        scene_of, {"where": {"body": "b"}, "traction": {"stress": stress, "side": side}}, dimension=3, spacing=0.01,
        bodies=[{"name": "b", "material": "soil", "shape": shape, "lattice": "rings"}], gravity=[0, 0, 0], contacts=[],
    )  # fmt: skip
    assert load.force.sum(axis=0) == pytest.approx(np.array(stress) * area)
    x = build_lattices(scene)[0].table.positions[load.ids]
    outside = np.sqrt((x[:, :2] ** 2).sum(axis=1)) > 0.02 if axis < 2 else x[:, 2] > 0.99
    assert outside.all() and len(load.ids) == (8 * 100 if axis < 2 else 3 * 4**2)


def test_traction_on_a_slope_and_on_points_of_a_file(scene_of, tmp_path):
    slope = {"name": "s", "material": "soil", "jitter": 0.2,
             "shape": {"type": "polygon", "vertices": [[0, 0], [0.2, 0], [0, 0.1]]}}  # fmt: skip
    entry = {"where": {"lower": [0.0, None]}, "traction": {"stress": [0.0, -1e3], "side": "y+"}}
    load, scene = boundary(scene_of, entry, bodies=[slope])
    ids, position = map(np.concatenate, zip(*((i, x) for i, x, *_ in build_lattices(scene)[0].chunks()), strict=True))
    columns = np.unique(np.floor(position[:, 0] / 0.01))
    assert len(load.ids) == len(columns)
    order = np.argsort(ids)
    height = position[order[np.searchsorted(ids[order], load.ids)], 1]
    assert ((height + load.lever[:, 1]) / 0.01 % 1.0).round(9) % 1.0 == pytest.approx(0.0)  # cells end on the grid
    assert np.ptp(load.lever[:, 1]) > 0.1 * 0.01 and not load.lever[:, 0].any()
    loaded = np.isin(ids, load.ids)
    for column in columns:
        inside = np.floor(position[:, 0] / 0.01) == column
        assert position[inside & loaded, 1] == position[inside, 1].max()
    np.savetxt(tmp_path / "p.csv", position, delimiter=",", header="x,y", comments="", fmt="%.17g")
    cloud = slope | {"jitter": 0.0, "shape": {"type": "points", "file": "p.csv"}}
    again, _ = boundary(scene_of, entry, bodies=[cloud], folder=tmp_path)
    assert len(again.ids) == pytest.approx(len(columns), abs=2) and (again.lever == [0.0, 0.005]).all()


@pytest.mark.parametrize(("shift", "lattice", "columns"), [(0.0, "shared", 10), (0.005, "own", 10), (0.05, "own", 15)])
def test_traction_on_a_region_that_spans_bodies_loads_the_last_one_alone(scene_of, shift, lattice, columns):
    """Twice the load was on two bodies that stand on each other; where one stands out its own top is loaded."""
    boxes = {"low": ([0.0, 0.0], [0.1, 0.05]), "high": ([shift, 0.05], [0.1 + shift, 0.1])}
    bodies = [{"name": name, "material": "soil", "lattice": lattice,
               "shape": {"type": "box", "lower": low, "upper": up}} for name, (low, up) in boxes.items()]  # fmt: skip
    entry = {"where": {"upper": [None, 1.0]}, "traction": {"stress": [0.0, -2e3], "side": "y+"}}
    load, scene = boundary(scene_of, entry, bodies=bodies)
    position = np.concatenate([x for lattice in build_lattices(scene) for _, x, *_ in lattice.chunks()])
    ids = np.concatenate([i for lattice in build_lattices(scene) for i, *_ in lattice.chunks()])
    loaded = position[np.isin(ids, load.ids)]
    assert len(loaded) == columns and (loaded[:, 1] > 0.09).sum() == 10
    assert len(np.unique(np.rint(loaded[:, 0] / 0.005))) == columns


def test_a_loaded_block_accelerates_by_newton(scene_of, started):
    entry = {"where": TOP, "traction": {"stress": [0.0, 500.0], "side": "y+"}}
    stage = {"name": "go", "type": "dynamics", "duration": 1.0, "boundaries": ["pull"]}
    sim = started(scene_of(boundaries={"pull": entry}, gravity=[0.0, 0.0], contacts=[], stages=[stage]))
    sim.loads = sim.stages[0].loads
    sim.apply_loads(0.0)
    for _ in range(50):
        sim.step()
    p = sim.particles
    assert (p.mass * p.velocity[:, 1]).sum() == pytest.approx(500.0 * 0.1 * sim.time, rel=1e-9)


def test_a_region_without_points_is_an_error(scene_of):
    with pytest.raises(InputError, match="no point of the scene lies in it"):
        boundary(scene_of, {"where": {"lower": [None, 5.0]}, "fix": ["x"]})
