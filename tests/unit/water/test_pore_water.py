"""Pore water: retention, mass, effective stress, bonding, and how the ledger counts it."""

import numpy as np
import pytest

from periporo.core.motion.rebuilds import rebuild
from periporo.core.points.forces import WORK
from periporo.core.water.pore_water import bonding_variable
from periporo.core.water.retention import RETENTION, conductivities, of_voids
from periporo.errors import InputError
from periporo.io.input.load import parse_scene
from periporo.materials.cam_clay import bonding_exponents

WATER = {"suction": 25e3, "retention": {"set": "fitted"}}
GEOSTATIC = {"type": "geostatic", "K0": 0.7}


def wet(scene_of, law, water=WATER, **keys):
    return scene_of(materials=law, pore_water=water, initial_stress=GEOSTATIC, **keys)


def at(name, suction, porosity=0.2, ratio=1.0):
    return of_voids(*RETENTION[name]).saturation(suction, np.array([porosity]), np.array([ratio]))[0]


def test_table_from_a_file(tmp_path, scene_of, started, cam_clay_input):
    (tmp_path / "swrc.csv").write_text("suction, saturation\n0, 1\n20e3, 0.9\n100e3, 0.5\n")
    water = {"suction": 20e3, "retention": {"table": "swrc.csv"}}
    sim = started(wet(scene_of, cam_clay_input, water), tmp_path)
    assert sim.particles.saturation == pytest.approx(0.9)
    (tmp_path / "swrc.csv").write_text("suction,saturation,conductivity\n0,1,1\n20e3,0.9,0.4\n100e3,0.5,0\n")
    found = started(wet(scene_of, cam_clay_input, water), tmp_path).point_processes
    curves = next(process.curves for process in found if hasattr(process, "curves"))
    relative = conductivities(curves, np.zeros(2, np.int64), np.array([20e3, 60e3]), *np.ones((2, 2)))
    assert relative.tolist() == pytest.approx([0.4, 0.2])
    (tmp_path / "swrc.csv").write_text("s,S\n0,1\n")
    with pytest.raises(InputError, match=r"first\s+line\s+must\s+be\s+suction,saturation"):
        started(wet(scene_of, cam_clay_input, water), tmp_path)


def test_a_law_without_porosity_is_refused(scene_of, started):
    with pytest.raises(InputError, match="no 'porosity'"):
        started(scene_of(pore_water=WATER))


def test_start(scene_of, started, cam_clay_input):
    """Density, stress and bonding of the start: sigma_bar = sigma + S_r p_w I with the weight of the wet soil."""
    sim = started(wet(scene_of, cam_clay_input, correspondence="bond_projected"))
    p, block, s_r = sim.particles, sim.bonds.blocks[0], at("fitted", 25e3)
    density = 2200 * 0.8 + 1000 * s_r * 0.2
    assert p.mass / p.volume == pytest.approx(density)
    depth = 0.08 - 0.5 * (p.position[sim.bonds.pairs.first, 1] + p.position[sim.bonds.pairs.second, 1])
    active = block.active
    vertical = -density * 9.81 * depth[active]
    suction = s_r * 25e3
    assert block.stress[active, 1] == pytest.approx(vertical - suction)
    assert block.stress[active, 0] == pytest.approx(0.7 * vertical - suction)
    assert block.total_stress[active, 1] == pytest.approx(vertical, abs=1e-9)
    assert block.total_stress[active, 3] == pytest.approx(block.stress[active, 3])
    xi = bonding_variable(25e3, s_r)
    assert xi == pytest.approx((1 + 0.2468 / (10.7 + 2.4 * 0.2468)) * (1 - s_r), rel=1e-4)
    assert block.state[active, 1] == pytest.approx(xi)
    b1, b2 = bonding_exponents(xi, 0.185, 1.42, 2.76, 0.12, 0.04)
    assert b1 > 0.0 and b2 < 1.0


def test_a_dry_scene_has_nothing_of_it(scene_of, started, cam_clay_input):
    sim = started(scene_of(materials=cam_clay_input))
    assert sim.bonds.blocks[0].total_stress is sim.bonds.blocks[0].stress
    assert not {"porosity", "saturation", "pore_stress"} & set(sim.particles.fields)
    assert [f.name for f in sim.bonds.blocks[0].material.state_fields] == ["preconsolidation", "opened"]


def test_a_free_block_shrinks_until_the_skeleton_carries_the_suction(started, cam_clay_input):
    """Patch test: a uniform strain balances uniform suction up to the very surface, bond by bond."""
    clay = cam_clay_input | {"preconsolidation": 1e9}
    scene = {
        "dimension": 2, "spacing": 0.01, "materials": {"soil": clay}, "pore_water": WATER | {"frozen": True},
        "bodies": [{"name": "block", "material": "soil", "jitter": 0.1,
                    "shape": {"type": "box", "lower": [0, 0], "upper": [0.12, 0.1]}}],
        # so far in compression that no swing takes the soil to its apex at zero
        "initial_stress": {"type": "uniform", "components": {"xx": -11e3, "yy": -11e3, "zz": -11e3}},
        "stages": [{"name": "rest", "type": "dynamics", "duration": 1.0, "damping": {"viscous": 1500.0}}],
    }  # fmt: skip
    sim = started(scene)
    sim.loads = sim.stages[0].loads
    for _ in range(1500):
        sim.step()
    p, block = sim.particles, sim.bonds.blocks[0]
    pressure = at("fitted", 25e3) * 25e3 - 11e3  # not yet carried
    # plane strain: the equal strains that take the two stresses in the plane there
    strain = -pressure / (2 * 25e6 + 2 / 3 * 15e6)
    assert p.dilation - 1.0 == pytest.approx(np.full(p.owned, 2 * strain), rel=2e-3)
    assert np.abs(block.total_stress[block.active][:, [0, 1, 3]]).max() < 2e-3 * pressure


def test_water_enters_and_leaves_and_the_ledger_closes(scene_of, started, cam_clay_input):
    """Mass is grains plus rho_w S_r phi V; what water brings in kinetic energy counts as external work."""
    soft = cam_clay_input | {"bulk_modulus": 3e5, "shear_modulus": 1e5}
    scene = wet(scene_of, soft, counts=(12, 20))
    scene["bodies"][0]["velocity"] = [0.0, -1.0]
    scene["correspondence"] = {"scheme": "point_state", "sharpened": True}  # or ways would not be those of velocities
    sim = started(scene)
    p = sim.particles
    grains, dry, mass = p.grain_mass.copy(), p.grain_mass / p.volume, p.mass.sum()
    gravity, seen = 0.0, 0.0
    for _ in range(300):
        before = p.position.copy(), p.mass.copy(), sim.time
        sim.step()
        p = sim.particles
        # half-step velocities, from the drift
        dt = sim.time - before[2]
        middle = (p.position - before[0]) / dt
        gravity += -9.81 * (0.5 * (before[1] + p.mass) * dt * middle[:, 1]).sum()
        seen += (0.5 * (p.mass - before[1]) * (middle**2).sum(axis=1)).sum()
    volume = p.present_volume()
    porosity = 1.0 - (1.0 - 0.2) * (grains / dry) / volume
    assert p.porosity == pytest.approx(porosity, rel=1e-10)
    saturation = of_voids(*RETENTION["fitted"]).saturation(25e3, porosity, (1 - 0.2) / (1 - porosity))
    assert p.saturation == pytest.approx(saturation, rel=1e-9)
    assert p.mass == pytest.approx(grains + 1000 * saturation * porosity * volume, rel=1e-12)
    assert np.ptp(p.porosity) > 1e-3 and abs(p.mass.sum() / mass - 1.0) > 1e-4
    external = p.work[:, WORK.index("external")].sum()
    assert abs(seen) > 1e-6
    assert external - gravity == pytest.approx(seen, rel=1e-6)
    energies = sim.ledger.entries()
    assert abs(energies["energy_residual"] - energies["integration_term"]) < 1e-12 * energies["kinetic_energy"]


def test_frozen_water_is_a_closed_system(scene_of, started, cam_clay_input):
    soft = cam_clay_input | {"bulk_modulus": 3e5, "shear_modulus": 1e5}
    scene = scene_of(materials=soft, pore_water=WATER | {"frozen": True}, contacts=[], gravity=[0.0, 0.0])
    scene["bodies"][0]["velocity"] = [0.3, 0.0]
    scene["initial_stress"] = {"type": "uniform", "components": {"xx": -15e3, "yy": -15e3, "zz": -15e3}}
    sim = started(scene)
    p = sim.particles
    mass, saturation = p.mass.copy(), p.saturation.copy()
    momentum = (p.mass[:, None] * p.velocity).sum(axis=0)
    for _ in range(100):
        sim.step()
    p = sim.particles
    assert (p.mass == mass).all() and (p.saturation == saturation).all()
    assert np.ptp(p.porosity) > 1e-4  # while the pores do change
    assert (p.mass[:, None] * p.velocity).sum(axis=0) == pytest.approx(momentum, abs=1e-10 * momentum[0])


def test_internal_work_is_that_of_the_total_stress(scene_of, started, cam_clay_input):
    """sum c (sigma_bar + S_r s I) : d_eps of bonds is minus the internal force's work, to 1e-4 and better with dt."""
    errors = []
    for dt in (4e-5, 2e-5):
        soft = cam_clay_input | {"bulk_modulus": 3e5, "shear_modulus": 1e5, "preconsolidation": 1e7}
        scene = wet(scene_of, soft, contacts=[], time_step={"fixed": dt}, correspondence="bond_projected")
        sim = started(scene)
        sim.skin = sim.largest_skin  # the rows must stay
        rebuild(sim)
        sim.step()
        rebuilds, before = sim.rebuild_count, sim.particles.work[:, WORK.index("internal")].sum()
        block, p = sim.bonds.blocks[0], sim.particles
        power, steps = 0.0, round(4e-3 / dt)
        rows = np.arange(len(block.pair))
        for _ in range(steps):
            last = block.total_stress.copy(), sim.bonds.layout.volumes(block, sim.bonds.pairs, p, rows)
            sim.step()
            volumes = sim.bonds.layout.volumes(block, sim.bonds.pairs, p, rows)
            mean = 0.5 * (last[0] + block.total_stress)
            double = (mean * block.strain_increment * np.array([1, 1, 1, 2])).sum(axis=1)
            power += (0.5 * (last[1] + volumes) * double * block.active).sum()
        work = before - sim.particles.work[:, WORK.index("internal")].sum()
        assert sim.rebuild_count == rebuilds
        errors.append(abs(power / work - 1.0))
    assert errors[0] < 1e-4 and errors[1] < 0.7 * errors[0]


def test_output_fields(scene_of, started, cam_clay_input):
    from periporo.core.points import fields

    sim = started(wet(scene_of, cam_clay_input))
    names = ("porosity", "saturation", "suction", "bonding")
    values = fields.values(sim, names)
    assert fields.available(sim)["suction"].unit == "Pa"
    assert values["porosity"] == pytest.approx(0.2) and values["suction"] == pytest.approx(25e3)
    assert values["saturation"] == pytest.approx(at("fitted", 25e3))
    assert values["bonding"] == pytest.approx(sim.bonds.blocks[0].material.initial_bonding)


@pytest.mark.parametrize("scheme", ["standard", "sub_horizon", "sub_horizon_published"])
def test_every_scheme_feels_the_water(scheme, scene_of, started, cam_clay_input):
    """The start is in equilibrium with the suction: without it in the force, 25 kPa would burst the block."""
    sim = started(wet(scene_of, cam_clay_input, correspondence=scheme))
    weight = sim.particles.mass[0] * 9.81
    assert np.abs(sim.particles.internal_force).max() < 30 * weight
    for block in sim.bonds.blocks:
        block.total = None
    sim.scheme.internal_force(sim.particles, sim.bonds, sim.halo, sim.particles.internal_force)
    assert np.abs(sim.particles.internal_force).max() > 100 * weight


def test_a_phreatic_line_that_slopes(scene_of, started):
    """Pressure by the depth below the line above each point, level beyond its ends; stress with buoyancy below it."""
    sand = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    water = {"phreatic_line": [[-0.03, 0.02], [0.03, 0.08]], "porosity": 0.4}
    start = {"type": "geostatic", "K0": 0.5}
    scene = scene_of(counts=(10, 10), materials=sand, pore_water=water, initial_stress=start)
    sim = started(scene)
    p = sim.particles
    x, y = p.position.T
    table = np.clip(x + 0.05, 0.02, 0.08)
    pressure = 9810.0 * np.maximum(table - y, 0.0)
    assert p.pore_pressure == pytest.approx(pressure, abs=1e-9)
    weight = (1590.0 + 400.0) * 9.81 * (0.1 - y)  # no suction: all pores are full
    stress = sim.bonds.blocks[0].stress
    assert stress[:, 1] == pytest.approx(pressure - weight) and stress[:, 0] == pytest.approx(0.5 * stress[:, 1])
    with pytest.raises(InputError, match="one after another across gravity"):
        started(scene | {"pore_water": water | {"phreatic_line": [[0.03, 0.02], [-0.03, 0.08]]}})
    with pytest.raises(InputError, match="exactly one of"):
        parse_scene(scene | {"pore_water": water | {"water_table": 0.1}})
    solid = scene_of(3, (4, 4, 4), materials=sand, pore_water=water | {"phreatic_line": [[0, 0, 0], [1, 0, 1]]})
    with pytest.raises(InputError, match="a line is for two dimensions"):
        parse_scene(solid)
