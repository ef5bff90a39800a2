"""Water that cannot leave its point: pressure from volume, Skempton's B, stiffness, conservation, equilibrium."""

import numpy as np
import pytest

from periporo.core.motion.timestep import highest_frequency
from periporo.core.points.fields import values
from periporo.errors import InputError
from periporo.io.input.load import parse_scene

BULK, PORES = 2.2e9, 0.4
SAND = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
FULL = {"suction": 0, "drainage": "undrained", "porosity": PORES}
STILL = {"gravity": None, "contacts": [], "time_step": {"fixed": 1e-7}}


class Affine:
    """Moves every point with the velocity G x."""

    def __init__(self, gradient):
        self.gradient = np.array(gradient, float)

    def apply(self, p, time, dt, closing_step):
        if not closing_step:
            p.velocity[:] = p.position @ self.gradient.T

    def foresee(self, p, time, dt, velocity):
        velocity[:] = p.position[: p.owned] @ self.gradient.T

    def hold_zero(self, p, free):
        free[:] = 0.0


def strained(sim, gradient, steps):
    sim.prescribed_motions = [Affine(gradient)]
    for _ in range(steps):
        sim.step()
    return sim.particles


@pytest.mark.parametrize("dimension, scheme", [(2, None), (3, {"scheme": "point_state"}), (2, "standard")])
def test_skemptons_b(dimension, scheme, scene_of, started):
    """Isotropic total stress goes to the water by B = 1/(1 + phi K/K_w)."""
    keys = STILL | {"pore_water": FULL} | ({} if scheme is None else {"correspondence": scheme})
    sim = started(scene_of(dimension, (6, 5) if dimension == 2 else (5, 5, 4), materials=SAND, **keys))
    p = strained(sim, -np.eye(dimension), 10)
    strain = 10 * 1e-7 * dimension
    assert p.pore_pressure == pytest.approx(BULK / PORES * strain, rel=1e-4)
    skeleton = -sim.bonds.blocks[0].stress[:, :3].mean(axis=1)
    assert p.pore_pressure / (p.pore_pressure + skeleton) == pytest.approx(1 / (1 + PORES * 25e6 / BULK), rel=1e-5)


def test_an_undrained_element_of_clay(scene_of, started, cam_clay_input):
    """V13 with water: sheared at constant total mean stress it ends at p = -625.117, q = 687.629, u = p_total - p."""
    clay = cam_clay_input | {"preconsolidation": 1250.0, "viscosity": 0.0}
    start = {"type": "uniform", "components": {"xx": -1e3, "yy": -1e3, "zz": -1e3}}
    water = {"suction": 0, "drainage": "undrained"}
    keys = STILL | {"pore_water": water, "initial_stress": start, "time_step": {"fixed": 1e-6}}
    sim = started(scene_of(counts=(4, 4), materials=clay, **keys))
    block, stiffness = sim.bonds.blocks[0], BULK / 0.2 + 25e6
    for _ in range(2000):
        total = block.total_stress[:, :3].mean()
        rate = (-1e3 - total) / stiffness / (2 * 1e-6)
        strained(sim, [[rate + 100.0, 0.0], [0.0, rate - 100.0 / (1.0 + 1e-6 * 100.0)]], 1)  # area stays
    stress, p = block.stress, sim.particles
    mean = stress[:, :3].mean(axis=1)
    q = np.sqrt(1.5 * ((stress[:, :3] - mean[:, None]) ** 2).sum(axis=1) + 3 * stress[:, 3] ** 2)
    assert mean == pytest.approx(-625.11716, rel=1e-3) and q == pytest.approx(687.62888, rel=1e-3)
    assert p.pore_pressure == pytest.approx(1e3 - 625.11716, rel=2e-3)


def test_the_step_knows_the_stiffness_of_the_water(scene_of, started):
    """The highest frequency grows by the root of (K + K_w/phi + 4/3 mu) over the drained modulus, for affine modes."""
    scene = scene_of(counts=(8, 8), materials=SAND, gravity=None, contacts=[])
    dry, wet = started(scene), started(scene | {"pore_water": FULL})
    density = wet.particles.mass[0] / dry.particles.mass[0]
    ratio = highest_frequency(wet) / highest_frequency(dry) * np.sqrt(density)
    assert ratio == pytest.approx(np.sqrt((45e6 + BULK / PORES) / 45e6), rel=0.15)
    soft = started(scene | {"pore_water": FULL | {"bulk_modulus": 1e6}})
    assert highest_frequency(soft) / highest_frequency(dry) * np.sqrt(density) == pytest.approx(1.0, abs=0.05)


def test_unsaturated_water_keeps_its_mass(scene_of, started):
    """Squeezing fills the pores: S = w/V_p, the suction follows the curve, and in full pores pressure takes over."""
    curve = {"van_genuchten": {"alpha": 0.2, "n": 2.0, "residual": 0.1}}
    water = FULL | {"suction": 10e3, "retention": curve}
    sim = started(scene_of(counts=(5, 5), materials=SAND, **STILL | {"pore_water": water}))
    p = sim.particles
    mass, content = p.mass.copy(), p.water_content.copy()
    filled = 0.1 + 0.9 / np.sqrt(1 + 2.0**2)
    assert p.saturation == pytest.approx(filled)
    history = []
    for _ in range(40):
        p = strained(sim, -6e3 * np.eye(2), 5)
        volume = p.volume * p.pore_dilation
        pores = volume - 0.6 * p.volume
        assert values(sim, ["porosity"])["porosity"] == pytest.approx(pores / volume, rel=1e-12)
        assert p.saturation * pores * (1 + p.pore_pressure / BULK) == pytest.approx(content, rel=1e-12)
        history.append((p.saturation[0], p.pore_pressure[0]))
    saturation, pressure = np.array(history).T
    suction = -pressure[pressure < -10.0]
    assert 20 < len(suction) < 39 and (np.diff(pressure) > 0.0).all()
    assert saturation[: len(suction)] == pytest.approx(0.1 + 0.9 / np.sqrt(1 + (suction / 5e3) ** 2), rel=1e-12)
    assert saturation[-1] == 1.0 and pressure[-1] > 1e6
    assert (p.mass == mass).all() and (p.water_content == content).all()


def test_a_saturated_column_comes_to_rest_with_buoyant_weight(scene_of, started):
    """Hydrostatic pressure in rest, effective stress of the buoyant weight, and nothing moves after the relaxation."""
    water = {"water_table": 0.2, "porosity": PORES, "drainage": "undrained"}
    sides = {"where": {"lower": [None, 0.0]}, "fix": ["x"]}
    scene = scene_of(
        counts=(6, 20), materials=SAND, pore_water=water, initial_stress={"type": "geostatic", "K0": 0.5},
        boundaries={"sides": sides},
        stages=[{"name": "rest", "type": "relax", "tolerance": 1e-8, "boundaries": ["sides"]},
                {"name": "wait", "type": "dynamics", "duration": 1e-4, "boundaries": ["sides"]}],
    )  # fmt: skip
    sim = started(scene)
    p = sim.particles
    depth = 0.2 - p.initial_position[:, 1]
    density = 1590.0 + 1000.0 * PORES
    assert p.pore_pressure == pytest.approx(1000 * 9.81 * depth)
    assert p.mass == pytest.approx(density * 1e-4, rel=1e-5)
    effective = -(density - 1000.0) * 9.81 * depth
    assert sim.bonds.blocks[0].stress[:, 1] == pytest.approx(effective)
    assert sim.bonds.blocks[0].stress[:, 0] == pytest.approx(0.5 * effective)
    sim.run()
    p = sim.particles
    inner = (p.initial_position[:, 1] > 0.05) & (p.initial_position[:, 1] < 0.15)
    assert sim.bonds.blocks[0].stress[inner, 1] == pytest.approx(effective[inner], rel=0.015)
    assert p.pore_pressure[inner] == pytest.approx(1000 * 9.81 * depth[inner], rel=0.01)
    assert np.abs(p.velocity).max() < 1e-8


def test_what_undrained_water_needs_is_said(scene_of, started):
    scene = scene_of(materials=SAND, pore_water=FULL)
    with pytest.raises(InputError, match=r"needs a law there: choose correspondence\s+point_state or standard"):
        parse_scene(scene | {"correspondence": "bond_projected"}, ".")
    with pytest.raises(InputError, match="a level of water needs gravity"):
        parse_scene(scene | {"gravity": None, "pore_water": {"water_table": 0.1, "porosity": 0.4}}, ".")
    for water, words in (
        ({"porosity": 0.4}, "exactly one of"),
        ({"suction": 0, "water_table": 1.0}, "exactly one of"),
        ({"suction": 0, "largest_suction": 1e3}, "belongs to a water table"),
        (FULL | {"frozen": True}, "frozen is for drained water"),
    ):
        with pytest.raises(InputError, match=words):
            parse_scene(scene | {"pore_water": water}, ".")
    with pytest.raises(InputError, match=r"no 'porosity', which pore water needs; give\s+pore_water.porosity"):
        started(scene | {"pore_water": {"suction": 0}})


def test_pressures_of_soil_that_flows_are_smoothed_and_water_is_kept(scene_of, started):
    """Points that flow take differences away, and none of water at rest; elastic soil has nothing of it."""
    law = SAND | {"model": "drucker_prager", "cohesion": 100.0, "friction_angle": 30.0}
    water = {k: v for k, v in FULL.items() if k != "suction"} | {"water_table": 0.2, "bulk_modulus": 1e8}
    sim = started(scene_of(materials=law, pore_water=water, initial_stress={"type": "geostatic", "K0": 0.5}))
    process, p = next(q for q in sim.point_processes if hasattr(q, "smooths")), sim.particles
    assert process.smooths and not started(scene_of(materials=SAND, pore_water=FULL)).particles.fields.get("smoothing")
    still = p.pore_pressure.copy()
    p.flow[:, 1], p.flow[:, 2] = 1.0, sim.spacing
    process._smooth(p, sim.dt)
    assert p.pore_pressure == pytest.approx(still, abs=1.0)
    p.water_content *= 1.0 + 1e-4 * np.random.default_rng(1).uniform(-1.0, 1.0, p.owned)
    process._fill_pressure(p)
    before, content = (p.pore_pressure - still).std(), p.water_content.sum()
    for _ in range(20):
        process._smooth(p, sim.dt)
    assert (p.pore_pressure - still).std() < 0.35 * before and p.pore_pressure.mean() > 0.9 * still.mean()
    assert p.water_content.sum() == pytest.approx(content, rel=1e-14)
