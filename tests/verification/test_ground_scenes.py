"""What a scene of soil may consist of, run the whole way: layers, K0, overburden, points from files, substrates."""

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.points import fields
from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

G, SPACING = 9.81, 0.1
SAND = {
    "model": "drucker_prager", "density": 1700.0, "bulk_modulus": 25e6, "shear_modulus": 15e6, "cohesion": 1e3,
    "friction_angle": 35.0,
}  # fmt: skip
CLAY = SAND | {"density": 2100.0, "cohesion": 20e3, "friction_angle": 15.0}
BLOCK = {"type": "box", "lower": [0.0, 0.0], "upper": [1.0, 2.0]}
WALLS = {
    "floor": {"where": {"upper": [None, 2 * SPACING]}, "fix": ["x", "y"]},
    "left": {"where": {"upper": [2 * SPACING, None]}, "fix": ["x"]},
    "right": {"where": {"lower": [1.0 - 2 * SPACING, None]}, "fix": ["x"]},
}


def run(shape=BLOCK, folder=".", layers=(), stage=None, **keys):
    """A simulation after its only stage: relaxation between walls, unless another is given."""
    stage = stage or {"name": "rest", "type": "relax", "boundaries": ["floor", "left", "right"]}
    scene = {
        "dimension": 2, "spacing": SPACING, "gravity": [0.0, -G], "materials": {"sand": SAND, "clay": CLAY},
        "bodies": [{"name": "soil", "material": "sand", "shape": shape, "layers": list(layers)}],
        "boundaries": WALLS, "stages": [stage],
    }  # fmt: skip
    sim = build(parse_scene(scene | keys, folder), MPI.COMM_SELF)
    sim.start()
    sim.run()
    return sim


def settled(sim):
    """Largest displacement, m."""
    p = sim.particles
    return np.sqrt(((p.position - p.initial_position) ** 2).sum(axis=1)).max()


def inner_stress(sim):
    """Heights and stress of the points away from walls, floor and surface."""
    x = sim.particles.initial_position
    inside = (np.abs(x[:, 0] - 0.5) < 0.21) & (x[:, 1] > 0.6) & (x[:, 1] < 1.6)
    return x[inside, 1], fields.values(sim, ("stress",))["stress"][inside]


def test_layered_ground_with_k0_is_in_equilibrium_and_stays():
    layers = [{"above": 1.0, "material": "clay"}]
    geostatic = run(layers=layers, initial_stress={"type": "geostatic", "K0": 0.7})
    height, stress = inner_stress(geostatic)
    weight = G * (2100.0 * np.minimum(2.0 - height, 1.0) + 1700.0 * np.maximum(1.0 - height, 0.0))
    away = np.abs(height - 1.0) > 2 * SPACING  # from the interface, which bonds of both layers cross
    assert stress[away, 1] == pytest.approx(-weight[away], rel=0.02)
    assert stress[away, 0] == pytest.approx(-0.7 * weight[away], rel=0.03)
    assert settled(geostatic) < 0.1 * settled(run(layers=layers))


def test_ground_below_a_free_surface_that_is_not_modelled():
    lid = WALLS | {"lid": {"where": {"lower": [None, 2.0 - 2 * SPACING]}, "fix": ["y"]}}
    stage = {"name": "rest", "type": "relax", "boundaries": ["floor", "left", "right", "lid"]}
    sim = run(stage=stage, boundaries=lid, initial_stress={"type": "geostatic", "K0": 0.5, "surface": 12.0})
    height, stress = inner_stress(sim)
    assert stress[:, 1] == pytest.approx(-1700.0 * G * (12.0 - height), rel=0.015)  # felt three horizons deep
    assert stress[:, 0] == pytest.approx(0.5 * stress[:, 1], rel=0.015)


def lattice():
    """The points of the block in the order of its lattice, (200, 2) m."""
    x, y = np.meshgrid(SPACING * (np.arange(10) + 0.5), SPACING * (np.arange(20) + 0.5), indexing="ij")
    return np.column_stack([x.ravel(), y.ravel()])


def write_csv(path):
    np.savetxt(path, lattice(), delimiter=",", header="x,y", comments="", fmt="%.17g")


def write_vtk(path):
    vtk = pytest.importorskip("vtk")
    points, grid, writer = vtk.vtkPoints(), vtk.vtkUnstructuredGrid(), vtk.vtkXMLUnstructuredGridWriter()
    points.SetDataTypeToDouble()
    for x, y in lattice():
        points.InsertNextPoint(x, y, 0.0)
    grid.SetPoints(points)
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    writer.Write()


@pytest.mark.parametrize("write, name", [(write_csv, "soil.csv"), (write_vtk, "soil.vtu")])
def test_points_from_a_file_move_as_those_of_the_shape_that_they_fill(tmp_path, write, name):
    fall = {"name": "fall", "type": "dynamics", "duration": 0.05, "boundaries": ["floor"]}
    write(tmp_path / name)
    from_file = run({"type": "points", "file": name}, tmp_path, stage=fall)
    from_shape = run(stage=fall)
    assert settled(from_shape) > 1e-5
    assert from_file.particles.position == pytest.approx(from_shape.particles.position, abs=1e-12)


@pytest.mark.parametrize("kind", ["points", "plane"])
def test_a_substrate_of_points_or_a_plane_carries_the_weight(kind):
    floor = {"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5}
    if kind == "points":
        box = {"lower": [-0.5, -0.5], "upper": [1.5, -0.03]}
        # without its friction, whose sign flips from step to step in a body that hardly moves
        floor = {"type": "short_range_published", "stiffness": 4e6, "friction": 0.0, "substrate": box}
    stage = {"name": "settle", "type": "dynamics", "duration": 0.4, "damping": {"viscous": 60.0}}
    sim = run(contacts=[floor], stage=stage, initial_stress={"type": "geostatic", "K0": 0.5}, materials={
        "sand": CLAY, "clay": CLAY
    })  # fmt: skip
    p = sim.particles
    assert (p.contact_force + p.friction_force)[:, 1].sum() == pytest.approx(p.mass.sum() * G, rel=1e-3)
    assert np.abs(p.velocity).max() < 1e-3
    assert 0.0 < p.position[:, 1].min() < SPACING
