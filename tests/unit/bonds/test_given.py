"""What the program tells laws that ask for it: time, place, rotation, deformation gradient, in runs and tests."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import periporo
from periporo.core.points.material import DEFORMATION_GRADIENT, PLACE, ROTATION, TIME, StateField, state_column
from periporo.materials import check_material, registry
from periporo.materials.elastic import Elastic
from periporo.materials.laboratory.point import MaterialPoint

SPIN = {2: (0.0, 0.0, 40.0), 3: (10.0, -20.0, 35.0)}  # rad/s
PARAMETERS = {"density": 1700.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}


class Curious(Elastic):
    """An elastic law that asks for everything, and keeps the product of all its rotations."""

    @property
    def state_fields(self):
        return TIME, PLACE, ROTATION, DEFORMATION_GRADIENT, StateField("turned", "1", kind="matrix")

    def initial_state(self, stress, ids, volume):
        state = np.zeros((len(stress), 31))
        state[:, 22:] = np.eye(3).ravel()
        return state

    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        turn, turned = of_rows(state, ROTATION.name), of_rows(state, "turned")
        state[:, 22:] = (turn @ turned).reshape(-1, 9)


def of_rows(state, name):
    start = state_column(Curious(**PARAMETERS), name, 4)
    return state[:, start : start + 9].reshape(-1, 3, 3)


@pytest.fixture
def curious(monkeypatch):
    monkeypatch.setattr(registry, "load", lambda name: Curious)


def spinning(dimension, scheme, steps=40):
    """A free block that turns and grows evenly, after some steps."""
    lower, upper = ([-0.04] * dimension, [0.04] * dimension)
    shape = {"type": "box", "lower": lower, "upper": upper}
    sim = periporo.Simulation.from_scene({
        "dimension": dimension, "spacing": 0.02, "correspondence": scheme,
        "materials": {"soil": {"model": "elastic"} | PARAMETERS},
        "bodies": [{"name": "block", "material": "soil", "shape": shape}],
        "stages": [{"name": "turn", "type": "dynamics", "duration": 1.0}],
    })  # fmt: skip
    sim.start()
    p = sim.particles
    x = p.position[: p.owned]
    space = np.pad(x, ((0, 0), (0, 3 - dimension)))
    p.velocity[: p.owned] = 4.0 * x + np.cross(SPIN[dimension], space)[:, :dimension]
    for _ in range(steps):
        sim.step()
    return sim


@pytest.mark.parametrize(
    "dimension, scheme", [(2, "point_state"), (2, "bond_projected"), (2, "sub_horizon"), (3, "point_state")]
)
def test_rows_of_a_run_are_told_how_they_move(curious, dimension, scheme):
    sim = spinning(dimension, scheme)
    block, p = sim.bonds.blocks[0], sim.particles
    rows = np.flatnonzero(block.active)
    state = block.state[rows]
    np.testing.assert_allclose(state[:, 0], sim.time, rtol=1e-14)
    first, second = sim.bonds.ends(block, rows)
    np.testing.assert_array_equal(state[:, 1 : 1 + dimension], 0.5 * (p.position[first] + p.position[second]))
    assert not state[:, 1 + dimension : 4].any()
    gradient, turned = of_rows(state, DEFORMATION_GRADIENT.name), of_rows(state, "turned")
    u, stretch, v = np.linalg.svd(gradient)
    np.testing.assert_allclose(turned, u @ v, atol=3e-4)  # stretch of 1e-3 turns with the soil
    turn = sim.time * np.array(SPIN[dimension])
    assert np.linalg.norm(turn) > 0.05
    expected = Rotation.from_rotvec(turn).as_matrix()
    np.testing.assert_allclose(turned, np.broadcast_to(expected, turned.shape), atol=2e-3)
    assert 1e-5 < np.abs(stretch - 1.0).max() < 1e-2
    if scheme == "point_state":  # the volume of a point follows the gradient before it is sharpened
        np.testing.assert_allclose(np.linalg.det(gradient), p.jacobian[first], rtol=2e-3)


def test_laws_that_ask_for_nothing_cost_nothing():
    sim = spinning(2, "point_state", steps=1)
    assert sim.bonds.blocks[0].given is None and sim.bonds.blocks[0].spin.size == 0


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_kit_tells_laws_what_they_ask_for(dimension):
    assert check_material(Curious(**PARAMETERS), dimension).law == "Curious"


def test_a_law_may_not_take_a_name_that_means_something_else():
    class Wrong(Curious):
        @property
        def state_fields(self):
            return (StateField("place", "m"), *super().state_fields[2:])

    with pytest.raises(AssertionError, match="'place' is told by the program"):
        check_material(Wrong(**PARAMETERS))


def test_the_laboratory_tells_it_too():
    """A stretch, a turn by 20 degrees, and a stretch: the law hears of the turn with the strain that follows."""
    point = MaterialPoint(Curious(**PARAMETERS), np.zeros(6))
    c, s = np.cos(np.radians(20)), np.sin(np.radians(20))
    turn, long = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), np.diag([1.01, 1.0, 1.0])
    point.deform(np.eye(3), turn @ long, 0.5, substeps=4)
    point.deform(turn @ long, 1.001 * turn @ long, 0.25)
    np.testing.assert_allclose(of_rows(point.state, DEFORMATION_GRADIENT.name)[0], 1.001 * turn @ long, atol=1e-8)
    np.testing.assert_allclose(of_rows(point.state, ROTATION.name)[0], turn, atol=1e-12)
    assert point.state[0, 0] == pytest.approx(0.75)
