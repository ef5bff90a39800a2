"""Bishop's factors: closed forms, slopes, effective stress in a scene and in a test, and what is refused."""

import numpy as np
import pytest

import periporo
from periporo.core.numerics.jit import kernel
from periporo.core.water.bishop import bishop_of, factor_of, pore_stress
from periporo.core.water.content import fill_content, fill_pressure, pore_stiffness
from periporo.core.water.retention import FULL, Retention, packed, tabulated, van_genuchten
from periporo.errors import InputError
from periporo.io.input.load import parse_scene
from periporo.io.schema.water import Bishop

SAND = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
CURVE = {"van_genuchten": {"alpha": 0.1, "n": 2.0, "residual": 0.2}}
SUCTION = 20e3
S = 0.2 + 0.8 / np.sqrt(5.0)
CHI = [
    (None, S), ({"power": 1.5}, S**1.5), ({"effective_power": 1.0}, 1.0 / np.sqrt(5.0)),
    ({"effective_power": 2.0}, 0.2), ({"air_entry": 5e3}, 4.0**-0.55), ({"air_entry": 30e3}, 1.0),
]  # fmt: skip


def row(bishop, curve=None):
    return np.array([bishop_of(None if bishop is None else Bishop(**bishop), curve or van_genuchten(0.1, 2.0, 0.2))])


@kernel
def _evaluate(factors, suction, saturation, slope, result):
    for i in range(len(suction)):
        result[i, 0], result[i, 1] = factor_of(factors, 0, suction[i], saturation[i], slope[i])


@pytest.mark.parametrize("bishop, chi", CHI)
def test_closed_forms_and_slopes(bishop, chi):
    """chi at one suction; its slope is that of differences; full pores have 1, and NaN stays."""
    suction = SUCTION + np.array([0.0, -0.5, 0.5])
    x = 1.0 + (1e-4 * suction) ** 2
    s, slope = 0.2 + 0.8 / np.sqrt(x), -0.8 * 1e-8 * suction / x**1.5
    found = np.empty((3, 2))
    _evaluate(row(bishop), suction, s, slope, found)
    assert found[0, 0] == pytest.approx(chi, rel=1e-12)
    assert found[0, 1] == pytest.approx(found[2, 0] - found[1, 0], rel=1e-6, abs=1e-16)
    _evaluate(row(bishop), np.array([0.0, -5e3, np.nan]), np.array([1.0, 1.0, np.nan]), np.zeros(3), found)
    assert found[:2, 0].tolist() == [1.0, 1.0] and np.isnan(found[2, 0])


def test_the_effective_saturation_of_other_curves():
    """That of a table is reckoned from its last saturation; pores that are always full have 1 whatever is asked."""
    table = tabulated([0.0, 1e4, 3e4], [1.0, 0.6, 0.4])
    one, material = {"effective_power": 1.0}, np.zeros(1, np.int64)
    dry = np.array([-1e4])
    assert -pore_stress(row(one, table), material, dry, np.array([0.6])) == pytest.approx(-1e4 * 0.2 / 0.6)
    assert pore_stress(row({"air_entry": 1e3}, Retention(FULL)), material, dry, np.ones(1)) == 1e4


@pytest.mark.parametrize("bishop, chi", CHI)
def test_stiffness_is_the_rate_of_the_pore_stress(bishop, chi):
    """What shut-in water adds to the bulk modulus, against a small compression; what softens adds nothing."""
    factors, curves, step = row(bishop), packed([van_genuchten(0.1, 2.0, 0.2)]), 1e-6
    material, start, one, bulk = np.zeros(1, np.int64), np.array([0.4]), np.ones(1), 1e7
    saturation, content, p = np.empty(1), np.empty(1), np.array([-SUCTION])
    fill_content(1, material, start, one, one, bulk, curves, p, saturation, content)
    expected = pore_stiffness(np.zeros(1, np.int64), material, start, bulk, curves, factors, p, one)
    stress = []
    for ratio in (1.0 - step, 1.0 + step):
        fill_pressure(1, material, start, one, np.array([ratio]), bulk, curves, content, saturation, p)
        stress.append(pore_stress(factors, material, p, saturation)[0])
    rate = (stress[1] - stress[0]) / (2.0 * step)
    assert expected == pytest.approx(max(rate, 0.0), rel=1e-4)
    assert stress[0] == pytest.approx(chi * SUCTION, rel=1e-3)


@pytest.mark.parametrize("dimension", [2, 3])
def test_effective_stress_of_a_scene(dimension, scene_of, started):
    """sigma_bar = sigma + chi p, with a factor for all and one for a soil of its own, drained and flowing."""
    water = {"suction": SUCTION, "retention": CURVE, "porosity": 0.4, "bishop": {"power": 2.0}}
    keys = {"materials": SAND, "gravity": None, "contacts": [],
            "initial_stress": {"type": "uniform", "components": {"xx": -1e3, "yy": -1e3, "zz": -1e3}}}
    scene = scene_of(dimension, (4,) * dimension, pore_water=water, **keys)
    for more in ({}, {"drainage": "flowing", "conductivity": 1e-5}):
        sim = started(scene | {"pore_water": water | more})
        assert sim.bonds.blocks[0].total_stress[:, :3] == pytest.approx(-1e3 + S**2 * SUCTION)
    name = next(iter(scene["materials"]))
    own = started(scene | {"pore_water": water | {"soils": {name: {"bishop": {"air_entry": 5e3}}}}})
    own.step()
    assert own.particles.pore_stress == pytest.approx(4.0**-0.55 * SUCTION, rel=1e-6)


def test_a_specimen_feels_its_factor():
    water = {"pressure": -SUCTION, "retention": CURVE, "bishop": {"effective_power": 2.0}}
    test = {"porosity": 0.4, "water": water, "phases": [{"type": "isotropic", "stress": 1e4, "rows": 1}]}
    assert periporo.drive(SAND, test)["p"].tolist() == pytest.approx([4e3, 14e3])
    with pytest.raises(InputError, match=r"bishop without a retention\s+curve"):
        periporo.drive(SAND, test | {"water": {"bishop": {"power": 1.0}}})


@pytest.mark.parametrize("water, message", [
    ({"bishop": {"power": 2.0, "air_entry": 1e3}, "retention": CURVE}, "give exactly one of: power"),
    ({"bishop": {}, "retention": CURVE}, "give exactly one of: power"),
    ({"bishop": {"power": 2.0}}, "without a retention curve"),
    ({"soils": {"soil": {"bishop": {"power": 2.0}}}}, "without a retention curve"),
    ({"bishop": {"air_entry": 0.0}, "retention": CURVE}, "greater than 0"),
])  # fmt: skip
def test_what_is_refused(water, message, scene_of):
    with pytest.raises(InputError, match=message.replace(" ", r"\s+")):
        parse_scene(scene_of(materials={"soil": SAND}, pore_water={"suction": 1e3, "porosity": 0.4} | water))
