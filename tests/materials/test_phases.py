"""Laboratory tests in phases: closed forms of elastic soil and Cam-Clay, water of the specimen, what is kept."""

import re

import numpy as np
import pytest

import periporo
from periporo import InputError
from periporo.core.water.pore_water import bonding_variable
from periporo.materials import DriveStopped, read_test
from periporo.materials.hypoplastic_sand import HypoplasticSand

K, G, POROSITY, WATER = 25e6, 15e6, 0.4, 2.2e9
ELASTIC = {"model": "elastic", "density": 1700.0, "bulk_modulus": K, "shear_modulus": G}
LAMBDA, KAPPA, M = 0.1, 0.02, 1.1
CLAY = {
    "model": "cam_clay", "grain_density": 2700.0, "porosity": POROSITY, "bulk_modulus": 10e6, "shear_modulus": 6e6,
    "critical_state_slope": M, "compression_index": LAMBDA, "swelling_index": KAPPA,
}  # fmt: skip
CONSOLIDATE = {"type": "isotropic", "stress": 1e5, "rows": 5}


def driven(material, *phases, **keys):
    return periporo.drive(material, {"phases": list(phases), **keys})


def test_skemptons_b():
    """1/(1 + phi K/K_w), of total pressure on a specimen that is shut, with the porosity that it has then."""
    columns = driven(
        ELASTIC, CONSOLIDATE, {"type": "isotropic", "stress": 2e5, "drainage": "undrained"}, porosity=POROSITY
    )
    assert columns["p"][5] == pytest.approx(1e5, rel=1e-9) and columns["pore_pressure"][5] == 0.0
    porosity = 1 - (1 - POROSITY) * np.exp(1e5 / K)
    assert columns["pore_pressure"][-1] / 1e5 == pytest.approx(1 / (1 + porosity * K / WATER), rel=1e-6)
    assert columns["p"][-1] + columns["pore_pressure"][-1] == pytest.approx(2e5, rel=1e-9)


def test_undrained_shear_of_an_elastic_specimen():
    """q = 3 G eps, and with incompressible water a third of it is pressure of the pores."""
    water = {"bulk_modulus": 1e12, "pressure": 3e5}
    columns = driven(
        ELASTIC, {"type": "triaxial", "strain": 0.01, "drainage": "undrained", "rows": 10},
        porosity=POROSITY, water=water, pressure=4e5,
    )  # fmt: skip
    assert columns["p"][0] == pytest.approx(1e5) and columns["axial_strain"][-1] == pytest.approx(0.01)
    np.testing.assert_allclose(columns["q"], 3 * G * columns["axial_strain"], rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(columns["pore_pressure"] - 3e5, columns["q"] / 3, rtol=1e-3, atol=1.0)


@pytest.mark.parametrize("keep", ["p", "ratio", "radial"])
def test_what_triaxial_phases_keep(keep):
    first = {"type": "triaxial", "stress": 1.5e5, "radial": 1e5, "rows": 3}
    columns = driven(CLAY, CONSOLIDATE, first, {"type": "triaxial", "strain": 0.02, "keep": keep, "rows": 8})
    assert columns["q"][8] == pytest.approx(0.5e5, rel=1e-8)
    radial = columns["radial_stress"]
    kept = {"p": columns["p"], "ratio": columns["q_over_p"], "radial": radial}[keep][8:]
    np.testing.assert_allclose(kept, kept[0], rtol=1e-8)
    assert columns["axial_strain"][-1] - columns["axial_strain"][8] == pytest.approx(0.02, rel=1e-9)


def test_virgin_compression_of_cam_clay():
    """Volumetric strain (lambda - kappa) ln(p2/p1) and the linear elastic one; the void ratio follows from it."""
    columns = driven(CLAY, CONSOLIDATE, {"type": "isotropic", "stress": 4e5, "rows": 10}, pressure=5e4)
    strain = (LAMBDA - KAPPA) * np.log(8.0) + 3.5e5 / 10e6
    assert columns["volumetric_strain"][-1] == pytest.approx(strain, rel=1e-6)
    assert columns["void_ratio"][-1] == pytest.approx(np.exp(-strain) / (1 - POROSITY) - 1, rel=1e-6)


def test_undrained_clay_ends_at_the_critical_state():
    """V13 at constant total mean stress: p and q as at constant volume, and the rest of p is the water's."""
    clay = CLAY | {"bulk_modulus": 25e6, "shear_modulus": 15e6, "compression_index": 0.12, "swelling_index": 0.04,
                   "porosity": 0.2, "preconsolidation": 1250.0}  # fmt: skip
    shear = {"type": "triaxial", "strain": 0.3, "drainage": "undrained", "keep": "p"}
    columns = driven(clay, shear, pressure=1e3)
    assert columns["p"][-1] == pytest.approx(625.11716, rel=1e-3)
    assert columns["q"][-1] == pytest.approx(687.62888, rel=1e-3)
    np.testing.assert_allclose(columns["p"] + columns["pore_pressure"], 1e3, rtol=1e-8)
    assert np.abs(columns["volumetric_strain"]).max() < 1e-6


def test_suction_is_taken_up_by_the_grains():
    """At constant net stress the effective stress grows by S s, and the bonding of the clay by xi."""
    water = {"retention": {"van_genuchten": {"alpha": 0.02, "n": 2.0}}}
    dry = {"type": "rest", "water_pressure": -5e4, "duration": 10.0, "rows": 20}
    columns = driven(ELASTIC, CONSOLIDATE, dry, porosity=POROSITY, water=water)
    saturation = (1 + (0.02 * 50.0) ** 2) ** -0.5
    assert columns["saturation"][-1] == pytest.approx(saturation, rel=1e-12)
    assert columns["p"][-1] == pytest.approx(1e5 + saturation * 5e4, rel=1e-9)
    assert columns["volumetric_strain"][-1] == pytest.approx(columns["p"][-1] / K, rel=1e-9)
    clay = driven(CLAY, CONSOLIDATE, dry, water=water, pressure=1e4)
    assert clay["bonding"][-1] == pytest.approx(float(bonding_variable(5e4, saturation)), rel=1e-6)


def test_a_law_that_keeps_its_void_ratio_needs_no_porosity():
    """Undrained, water too stiff to be pressed keeps the void ratio, and the pores are e/(1 + e) of the soil."""
    sand = HypoplasticSand.example().model_dump(exclude_none=True) | {"initial_void_ratio": 0.6}
    shear = {"type": "triaxial", "strain": 1e-3, "drainage": "undrained", "rows": 3}
    columns = driven({"model": "hypoplastic_sand"} | sand, shear, pressure=1e5, porosity=0.9)
    found = columns["void_ratio"]
    assert found[0] == 0.6 and columns["pore_pressure"][-1] != 0.0
    compressed = np.log((1 + found) / 1.6)  # of the volume, that of the water in 0.6/1.6 of it
    np.testing.assert_allclose(compressed[1:], -0.375 * columns["pore_pressure"][1:] / WATER, rtol=1e-3)


@pytest.mark.parametrize("kind, column, value", [("stress", "tau", 1e4), ("strain", "gamma", 1e-3)])
def test_cycles_of_simple_shear(kind, column, value):
    cycles = {"type": "simple_shear", "cycles": {"number": 3, kind: value}, "rows": 20, "duration": 1.0}
    columns = driven(ELASTIC, CONSOLIDATE, cycles)
    assert len(columns["time_s"]) == 6 + 3 * 20
    assert columns["time_s"][-1] - columns["time_s"][5] == pytest.approx(3.0)
    cycle = columns[column][5:].reshape(-1)
    assert cycle.max() == pytest.approx(value, rel=1e-9) and cycle.min() == pytest.approx(-value, rel=1e-9)
    assert (cycle[::20] == pytest.approx(0.0, abs=1e-9 * value)) and cycle[5] == pytest.approx(value, rel=1e-9)
    np.testing.assert_allclose(columns["tau"], G * columns["gamma"], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(columns["axial_stress"][5:], 1e5, rtol=1e-9)


def test_a_phase_ends_where_a_column_has_come():
    shear = {"type": "triaxial", "strain": 0.1, "rows": 1000, "stop": {"q": 5e4}}
    columns = driven(ELASTIC, CONSOLIDATE, shear, {"type": "oedometer", "stress": 3e5, "rows": 4})
    q = columns["q"][columns["phase"] == 1]
    assert 5e4 <= q[-1] < 5e4 + 1.1 * np.diff(q).max() and len(q) < 40
    assert columns["axial_stress"][-1] == pytest.approx(3e5, rel=1e-9)


def test_a_test_in_a_file(tmp_path):
    file = tmp_path / "shear.yaml"
    file.write_text("pressure: 1e5\nphases:\n  - {type: triaxial, strain: 0.01, rows: 4}\n")
    assert read_test(file).name == "shear"
    columns = periporo.drive(ELASTIC, file, pictures=tmp_path / "out")
    assert {f.name for f in (tmp_path / "out").iterdir()} == {f"shear_{n}.png" for n in ("stress_strain", "stress_path",
                                                                                       "volume")}  # fmt: skip
    assert columns["q"][-1] == pytest.approx(3 * G * 3 * K / (3 * K + G) * 0.01, rel=1e-9)  # E eps


@pytest.mark.parametrize(
    "text, words",
    [
        ("phases: [{type: triaxial}]", "exactly one of strain, stress, cycles"),
        ("phases: [{type: rest, strain: 0.1}]", "none of them"),
        ("phases: [{type: oedometer, strain: 0.1, keep: p}]", "keeps nothing, not p"),
        ("phases: [{type: triaxial, strain: 0.1, stop: {u: 3}}]", "no column 'u'"),
        ("phases: [{type: triaxial, strain: 0.1, drainage: undrained}]", "give the porosity at the start"),
        ("phases:\n  - {type: triaxial, strain: 0.1, kep: p}", "line 2.*did you mean 'keep'"),
        ("phases: [{type: triaxial, strain: 0.1, keep: ratio}]", "consolidate first"),
        ("phases: [{type: triaxial, strain: 0.1, stop: {void_ratio: 3}}]", "no number 'void_ratio'"),
    ],
)
def test_bad_tests_are_refused_with_their_line(tmp_path, text, words):
    file = tmp_path / "test.yaml"
    file.write_text(text)
    with pytest.raises(InputError, match=words.replace(".*", "(.|\n)*")):
        periporo.drive(ELASTIC, file)


def test_a_stress_that_cannot_be_reached_tells_the_phase():
    soft = CLAY | {"overconsolidation_ratio": 1.0}
    push = {"name": "push", "type": "triaxial", "stress": 5e5, "keep": "p", "rows": 50}
    with pytest.raises(DriveStopped, match=r"test, phase 1 \(push\), time .*: the prescribed stress cannot be") as e:
        driven(soft, CONSOLIDATE, push, pressure=9e4)
    axial, radial = (float(number) for number in re.findall(r"(?:to) ([\d.]+)", str(e.value))[:2])
    assert (axial + 2 * radial) / 3 == pytest.approx(1e5, rel=1e-4)
    assert axial - radial == pytest.approx(M * 1e5, rel=1e-3)  # its strength, whatever the rows
    assert 0.95 * M * 1e5 < e.value.columns["q"].max() < M * 1e5


def test_a_law_with_its_own_water_is_refused_others():
    with pytest.raises(InputError, match="its own pore pressure"):
        driven({"model": "arena"}, {"type": "triaxial", "strain": 0.1, "drainage": "undrained"})
