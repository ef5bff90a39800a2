"""Arena against the reference tables: Richardson-extrapolated paths (see docs/explanation/arena.md) and moduli."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from periporo.core.numerics import tensors
from periporo.materials.arena import Arena

DATA = Path(__file__).parent / "data" / "arena"
TABLES = (
    "p01_hydrostatic_dry",
    "p03_uniaxial_dry",
    "p05_uniaxial_S1",
    "p06_triaxial_compression_dry",
    "p09_uniaxial_dry_rate_1000",
    "p11_cyclic_uniaxial_dry",
)
RENAMED = {
    "phi0": "initial_porosity",
    "S0": "initial_saturation",
    "pw0": "initial_fluid_pressure",
    "phi_ref": "reference_porosity",
    "rho_fac": "p1_density_scale_fac",
}
SUFFIXES = ("11", "22", "33", "12", "23", "13")  # the program's order of components


def read_table(name):
    lines = (DATA / f"{name}.csv").read_text().splitlines()
    header = next(line for line in lines if line.startswith("# params:"))
    known = {RENAMED.get(k, k): v for k, v in json.loads(header.split(":", 1)[1]).items()}
    parameters = {k: v for k, v in known.items() if k in Arena.model_fields}
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    return parameters, {k: np.array([float(r[k]) for r in rows]) for k in rows[0]}


def tensor_columns(table, letter):
    return np.stack([table[letter + s] for s in SUFFIXES], axis=1)


def drive(material, time, strain, steps):
    """Stress and state after each row of a strain path, `steps` updates per row."""
    stress = np.zeros((1, strain.shape[1]))
    state = material.initial_state(stress, np.zeros((1, 2), np.int64), np.ones(1))
    stresses, states = [stress.copy()], [state.copy()]
    for row in range(1, len(strain)):
        increment = (strain[row] - strain[row - 1])[None] / steps
        for _ in range(steps):
            material.compute_stress(stress, increment, state, (time[row] - time[row - 1]) / steps)
        stresses.append(stress.copy())
        states.append(state.copy())
    return np.concatenate(stresses), np.concatenate(states)


def stress_error(stress, table):
    reference = tensor_columns(table, "d")
    return np.abs(stress - reference).max() / np.abs(reference).max()


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize(("substeps", "steps", "tolerance"), [(1, 10, 1e-4), (1, 100, 2e-6)])
def test_fixed_substeps(name, substeps, steps, tolerance):
    parameters, table = read_table(name)
    material = Arena(**parameters, substeps=substeps)
    stress, _ = drive(material, table["t"], tensor_columns(table, "e"), steps)
    assert stress_error(stress, table) < tolerance


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize(("requested", "reached"), [(1e-3, 2e-4), (1e-5, 1e-5)])
def test_error_control(name, requested, reached):
    parameters, table = read_table(name)
    material = Arena(**parameters, tolerance=requested)
    stress, state = drive(material, table["t"], tensor_columns(table, "e"), 1)
    assert stress_error(stress, table) < reached
    assert np.abs(state[:, 0] - table["evp_bar"]).max() < reached


@pytest.mark.parametrize("name", ("p05_uniaxial_S1", "p11_cyclic_uniaxial_dry", "p09_uniaxial_dry_rate_1000"))
def test_state_columns(name):
    parameters, table = read_table(name)
    material = Arena(**parameters, tolerance=1e-6)
    stress, state = drive(material, table["t"], tensor_columns(table, "e"), 1)
    columns = {f.name: state[:, i] for i, f in enumerate(material.state_fields) if f.kind == "scalar"}
    derived = material.derived_state(stress, state)
    for ours, theirs in (
        (columns["pore_pressure"], "pw"),
        (columns["compressive_strength"], "X"),
        (derived["porosity"], "phi"),
        (derived["saturation"], "Sw"),
        (derived["kappa"], "kappa"),
    ):
        scale = max(np.abs(table[theirs]).max(), 1e-300)
        assert np.abs(ours - table[theirs]).max() < 1e-5 * scale
    static = state[:, -6:] if material.rate_dependent else derived["quasistatic_stress"]
    reference = tensor_columns(table, "s")
    assert np.abs(static - reference).max() < 1e-5 * np.abs(reference).max()


def test_second_order():
    """Halving the substeps quarters the error, cyclic path included."""
    parameters, table = read_table("p11_cyclic_uniaxial_dry")
    strain = tensor_columns(table, "e")
    errors = [
        stress_error(drive(Arena(**parameters, substeps=1), table["t"], strain, n)[0], table) for n in (4, 8, 16)
    ]
    assert errors[0] / errors[1] > 3.0
    assert errors[1] / errors[2] > 3.0


def rotation(angle):
    axis = np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def drive_deformation(material, gradients):
    """Stress (1, 6) at the end of a path of deformation gradients, with Hughes-Winget rotation."""
    stress = np.zeros((1, 6))
    state = material.initial_state(stress, np.zeros((1, 2), np.int64), np.ones(1))
    one = np.eye(3)
    previous = gradients[0]
    for current in gradients[1:]:
        g = (current - previous) @ np.linalg.inv(current)
        g = g @ np.linalg.inv(one - 0.5 * g)
        spin = 0.5 * (g - g.T)
        q = np.linalg.solve(one - 0.5 * spin, one + 0.5 * spin)
        h = np.linalg.solve(one - 0.25 * spin, one + 0.25 * spin)
        increment = tensors.from_matrix((h @ (0.5 * (g + g.T)) @ h.T)[None], 6)
        stress[:] = tensors.from_matrix(q @ tensors.to_matrix(stress) @ q.T, 6)
        material.compute_stress(stress, increment, state, 1.0)
        previous = current
    return stress


def test_objectivity():
    """Half a turn on top of 20 % compression: the spatial stress is the rotated one of the plain path."""
    parameters, table = read_table("p10b_F_uniaxial_plus_rotation_dry")
    material = Arena(**parameters, substeps=1)
    stretch = [np.diag([1.0 - 0.2 * t, 1.0, 1.0]) for t in np.linspace(0.0, 1.0, 4001)]
    turned = [rotation(np.pi * t) @ u for t, u in zip(np.linspace(0.0, 1.0, 4001), stretch, strict=True)]
    plain = tensors.to_matrix(drive_deformation(material, stretch))[0]
    spatial = tensors.to_matrix(drive_deformation(material, turned))[0]
    half_turn = rotation(np.pi)
    expected = half_turn @ plain @ half_turn.T
    scale = np.abs(plain).max()
    assert np.abs(spatial - expected).max() / scale < 2e-6
    reference = tensors.to_matrix(tensor_columns(table, "s")[-1:])[0]
    assert np.abs(spatial - reference).max() / scale < 5e-6


def moduli(i1, **parameters):
    material = Arena(T1=0.0, T2=0.0, **parameters)
    stress = np.zeros((1, 6))
    state = material.initial_state(stress, np.zeros((1, 2), np.int64), np.ones(1))
    stress[:, :3] = i1 / 3.0
    return [float(v[0]) for v in material.elastic_moduli(stress, state)]


EXACT = {
    "b0": 0.00290858181781614,
    "b1": 0.47312420784766,
    "b2": 1.50567779375549,
    "b3": 2.57284042409447,
    "b4": 2.07992105987609,
}


@pytest.mark.parametrize(
    ("i1", "bulk", "parameters"),
    [
        (-0.01, 116004790.7105, {"initial_saturation": 0.0}),
        (-1e6, 200993992.6615, {"initial_saturation": 0.0}),
        (-1e8, 1046175329.3828, {"initial_saturation": 0.0}),
        (-0.01, 5190485531.77, {"initial_saturation": 1.0}),
        (-0.01, 4978302702.68, {"initial_saturation": 1.0, "initial_porosity": 0.42}),
        (-0.01, 116348059.2816119, {"initial_saturation": 0.0, **EXACT}),
        (-1e6, 201335456.1999204, {"initial_saturation": 0.0, **EXACT}),
        (-1e8, 1046521964.819405, {"initial_saturation": 0.0, **EXACT}),
        (-0.01, 5190747007.780967, {"initial_saturation": 1.0, **EXACT}),
    ],
)
def test_bulk_modulus(i1, bulk, parameters):
    """Check values at the reference density (K_fac = 1), to the digits given."""
    phi = parameters.setdefault("initial_porosity", 0.40)
    assert moduli(i1, reference_porosity=phi, **parameters)[0] == pytest.approx(bulk, rel=1e-9)


def test_elastic_uniaxial_slope():
    """q/p = 3 (1 - 2 nu)/(1 + nu) = 2/3 at nu = 0.35 inside the yield surface."""
    material = Arena(initial_saturation=0.0, nu2=0.0, p0=1e6, T1=0.0, T2=0.0)
    strain = np.zeros((2, 6))
    strain[1, 0] = -1e-3
    stress, state = drive(material, [0.0, 1.0], strain, 1)
    assert state[-1, 0] == 0.0
    assert tensors.equivalent_shear(stress[-1:])[0] / -tensors.mean(stress[-1:])[0] == pytest.approx(2 / 3, rel=1e-9)
