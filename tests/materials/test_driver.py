"""One driven point: closed forms, stress control, rotation, files and error messages."""

import argparse
import importlib.util
from typing import ClassVar

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from periporo.core.numerics.tensors import equivalent_shear, mean, to_matrix
from periporo.core.points.material import StateField, StepRefused, UpdatesFailed
from periporo.errors import InputError
from periporo.materials.arena import Arena
from periporo.materials.arena.variability import strength_factors
from periporo.materials.cam_clay import CamClay
from periporo.materials.drucker_prager import DruckerPrager
from periporo.materials.elastic import Elastic
from periporo.materials.laboratory.command import add_arguments, run
from periporo.materials.laboratory.drive import DriveStopped, drive
from periporo.materials.laboratory.files import load_material
from periporo.materials.laboratory.paths import (
    STRAIN_COLUMNS,
    STRESS_COLUMNS,
    DeformationPath,
    StrainPath,
    built_in_path,
    find_path,
    read_path,
)

K, MU = 25e6, 15e6
ELASTIC = Elastic(density=1700.0, bulk_modulus=K, shear_modulus=MU)
CLAY = CamClay.example().model_copy(update={"viscosity": 0.0, "overconsolidation_ratio": 1.0})
MATERIAL = "model: elastic\ndensity: 1700.0\nbulk_modulus: 25e6\nshear_modulus: 1.5e7\n"


def stresses(columns):
    return np.stack([columns[name] for name in STRESS_COLUMNS], axis=1)


def strains(columns):
    return np.stack([columns[name] for name in STRAIN_COLUMNS], axis=1)


def written(folder, text, name="path.csv"):
    file = folder / name
    file.write_text(text)
    return file


@pytest.mark.parametrize("steps", [100, 1000])
def test_simple_shear_of_a_hypoelastic_solid(steps):
    """V10: sigma_xy = mu sin(gamma), sigma_xx = mu (1 - cos(gamma)); second order, 6e-7 mu at 1000 steps."""
    path = built_in_path("simple_shear", f"confining=0,strain=2,rows={steps}")
    result = drive(ELASTIC, path, substeps=1)
    gamma = result["F12"]
    exact = np.zeros((steps + 1, 6))
    exact[:, 3] = MU * np.sin(gamma)
    exact[:, 0] = MU * (1 - np.cos(gamma))
    exact[:, 1] = -exact[:, 0]
    assert np.max(np.abs(stresses(result) - exact)) < 0.6 * MU / steps**2


def test_rows_far_apart_are_joined_by_stretch_and_rotation():
    """Simple shear to 2 in a single row: sigma = 2 mu R ln(U) R^T, the stretches are exp(+-asinh(gamma/2))."""
    path = DeformationPath("shear", np.array([0.0, 1.0]), np.array([np.eye(3), [[1, 2, 0], [0, 1, 0], [0, 0, 1]]]))
    result = stresses(drive(ELASTIC, path, 1))[-1]
    size = 2 * MU * np.arcsinh(1.0) / np.sqrt(2.0)
    np.testing.assert_allclose(result, [size, -size, 0, size, 0, 0], rtol=1e-12, atol=1e-6)


@pytest.mark.parametrize("rows", [1, 2, 9])
@pytest.mark.parametrize("angle", [90.0, 170.0])
def test_turns_of_any_size_make_no_strain(rows, angle):
    """A quarter turn, and nearly half a one, take -100 kPa along x with them, however few rows tell of it."""
    turn = Rotation.from_euler("z", np.linspace(0.0, angle, rows + 1)[:, None], degrees=True).as_matrix()
    start = np.array([-1e5, 0, 0, 0, 0, 0])
    result = drive(ELASTIC, DeformationPath("turn", np.linspace(0.0, 1.0, rows + 1), turn), 10, start)
    expected = turn[-1] @ to_matrix(start[None])[0] @ turn[-1].T
    assert np.abs(to_matrix(stresses(result)[-1:])[0] - expected).max() < 1e-9 * 1e5
    assert np.abs(strains(result)).max() < 1e-13


def test_matter_that_is_turned_inside_out_is_refused():
    gradient = np.array([np.eye(3), np.diag([1.0, -1.0, 1.0])])
    with pytest.raises(InputError, match="row 1: the determinant of F must be positive"):
        drive(ELASTIC, DeformationPath("mirror", np.array([0.0, 1.0]), gradient))


def test_stretch_while_turning_is_the_stretch_turned():
    """Of a soil that yields, at 4.5 degrees a row: the chord between two rotations would strain it by 8e-4."""
    law, time = Arena(initial_saturation=0.0), np.linspace(0.0, 1.0, 41)
    turn = Rotation.from_rotvec(np.pi * time[:, None] * np.array([1, 2, 3]) / np.sqrt(14)).as_matrix()
    stretch = np.tile(np.eye(3), (41, 1, 1))
    stretch[:, 0, 0] = 1.0 - 0.2 * time
    straight = stresses(drive(law, DeformationPath("straight", time, stretch)))
    turned = stresses(drive(law, DeformationPath("turned", time, turn @ stretch)))
    expected = turn @ to_matrix(straight) @ turn.transpose(0, 2, 1)
    assert np.abs(to_matrix(turned) - expected).max() < 1e-12 * np.abs(straight).max()


def test_rigid_rotation_turns_stress_and_makes_no_strain():
    angle = np.linspace(0.0, 2 * np.pi, 201)
    turn = np.tile(np.eye(3), (201, 1, 1))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0] = np.sin(angle)
    turn[:, 0, 1] = -turn[:, 1, 0]
    start = np.array([-3e4, -1e4, -2e4, 5e3, 1e3, -2e3])
    result = drive(ELASTIC, DeformationPath("turn", angle, turn), 1, start)
    assert np.max(np.abs(strains(result))) < 1e-13
    np.testing.assert_allclose(
        equivalent_shear(stresses(result)), equivalent_shear(start[None])[0], rtol=1e-9
    )
    tensor = np.array([[-3e4, 5e3, -2e3], [5e3, -1e4, 1e3], [-2e3, 1e3, -2e4]])
    for row in (37, 200):
        expected = turn[row] @ tensor @ turn[row].T
        found = stresses(result)[row]
        np.testing.assert_allclose(found[:3], np.diag(expected), rtol=1e-11)
        np.testing.assert_allclose(found[3:], expected[[0, 1, 0], [1, 2, 2]], rtol=1e-10)


class RememberedStress:
    """Elastic law that keeps a copy of its stress as tensor state: both must turn alike."""

    density = 1700.0
    state_fields = (StateField("age", "s"), StateField("copy", "Pa", kind="tensor"))

    def initial_state(self, stress, ids, volume):
        return np.hstack([np.zeros((len(stress), 1)), stress])

    def compute_stress(self, stress, strain_increment, state, dt):
        before = stress.copy()
        ELASTIC.compute_stress(stress, strain_increment, state, dt)
        state[:, 0] += dt
        state[:, 1:] += stress - before

    def elastic_moduli(self, stress, state):
        return ELASTIC.elastic_moduli(stress, state)

    def derived_state(self, stress, state):
        return {"pore_pressure": -stress[:, 0], "double": 2 * stress}


def test_tensor_state_turns_and_every_state_has_a_column():
    path = built_in_path("simple_shear", "strain=1,rows=10,rate=0.5")
    result = drive(RememberedStress(), path, 7)
    np.testing.assert_allclose(result["age"], result["time_s"], rtol=1e-13)
    for name in STRESS_COLUMNS:
        np.testing.assert_allclose(
            result[name.replace("stress", "copy")], result[name], rtol=1e-12, atol=1e-6
        )
    np.testing.assert_array_equal(result["pore_pressure"], -result["stress_xx"])
    assert list(result)[:2] == ["time_s", "F11"] and "double_xz" in result
    np.testing.assert_array_equal(result["double_xy"], 2 * result["stress_xy"])
    assert result["stress_xy"][-1] > 0.1 * MU


def test_stress_control_gives_uniaxial_stress():
    """Axial strain with free sides: E = 9 K mu/(3 K + mu), nu = (3 K - 2 mu)/(6 K + 2 mu)."""
    target = np.zeros((3, 6))
    target[:, 1] = [0.0, -1e-3, 2e-3]
    controlled = np.array([True, False, True, True, True, True])
    result = drive(ELASTIC, StrainPath("pull", np.arange(3.0), target, controlled), 2)
    young, poisson = 9 * K * MU / (3 * K + MU), (3 * K - 2 * MU) / (6 * K + 2 * MU)
    np.testing.assert_allclose(result["stress_yy"], young * target[:, 1], rtol=1e-10)
    np.testing.assert_allclose(result["strain_xx"], -poisson * target[:, 1], rtol=1e-10, atol=1e-18)
    assert np.max(np.abs(stresses(result)[:, [0, 2, 3, 4, 5]])) < 1e-6


def test_all_stresses_prescribed():
    """Isotropic compression of Cam-Clay by stress needs the strain of the closed form."""
    start = np.array([-1e3, -1e3, -1e3, 0, 0, 0])
    target = np.stack([start, 1.86743584 * start])
    path = StrainPath("squeeze", np.array([0.0, 1.0]), target, np.ones(6, dtype=bool))
    result = drive(CLAY, path, 20, start)
    assert 3 * mean(strains(result))[-1] == pytest.approx(-0.05, rel=1e-7)
    np.testing.assert_allclose(stresses(result), target, rtol=1e-9)


def test_drained_triaxial_test_reaches_the_strength():
    """Compression cone: q = 6 (|p| sin(phi) + c cos(phi))/(3 - sin(phi)) at constant lateral stress."""
    soil = DruckerPrager.example().model_copy(update={"match": "compression"})
    result = drive(soil, built_in_path("triaxial", "confining=2e4,strain=0.02,rows=20"))
    final = stresses(result)[-1:]
    phi = np.radians(35.0)
    factor = 6 / (3 - np.sin(phi))
    strength = factor * (np.sin(phi) * -mean(final)[0] + 1e3 * np.cos(phi))
    assert equivalent_shear(final)[0] == pytest.approx(strength, rel=1e-9)
    np.testing.assert_allclose(stresses(result)[:, [0, 2]], -2e4, rtol=1e-9)
    np.testing.assert_allclose(result["strain_xx"], result["strain_zz"], rtol=1e-9, atol=1e-15)
    assert result["strain_yy"][-1] == -0.02 and result["time_s"][-1] == pytest.approx(20.0)


def test_undrained_and_oedometer_and_isotropic_paths():
    for name, volumetric in (("undrained", 0.0), ("oedometer", -0.05), ("isotropic", -0.05)):
        result = drive(CLAY, built_in_path(name, "confining=1e3,strain=0.05,rows=10"))
        assert 3 * mean(strains(result))[-1] == pytest.approx(volumetric, abs=1e-15)
        assert stresses(result)[0].tolist() == [-1e3, -1e3, -1e3, 0, 0, 0]
        assert len(result["preconsolidation"]) == 11
    assert -mean(stresses(result))[-1] == pytest.approx(1867.43584, rel=1e-8)
    assert result["strain_yy"][-1] == result["strain_xx"][-1]


def test_impossible_stress_is_an_error_with_its_place():
    """It says how far the stress came: to the strength in compression, 1.1547 of the cohesion in simple shear."""
    clay = DruckerPrager.example().model_copy(update={"friction_angle": 0.0, "dilation_angle": 0.0})
    strength = 2e3 / np.sqrt(3.0)
    target = np.zeros((4, 6))
    target[:, 3] = [0.0, 500.0, 2e3, 3e3]
    path = StrainPath("shear", np.arange(4.0), target, np.array([False, False, False, True, False, False]))
    with pytest.raises(DriveStopped, match="shear, row 2, time 2 s: .* stress_xy came to .* of 2000 Pa") as stop:
        drive(clay, path)
    came = float(str(stop.value).split("came to ")[1].split()[0])
    assert 0.98 * strength < came <= strength * (1 + 1e-6)
    assert stop.value.columns["stress_xy"].tolist() == pytest.approx([0.0, 500.0], rel=1e-9)


class Failing(Elastic):
    """Fails, or loses its numbers, beyond a strain of 2e-3."""

    how: str = "fails"
    state_fields: ClassVar[tuple] = (StateField("strain_xx", "1"),)

    def initial_state(self, stress, ids, volume):
        return np.zeros((len(stress), 1))

    def compute_stress(self, stress, strain_increment, state, dt):
        state += strain_increment[:, :1]
        super().compute_stress(stress, strain_increment, state, dt)
        over = np.flatnonzero(state[:, 0] > 2e-3)
        if len(over) and self.how == "fails":
            raise UpdatesFailed(over, "too far")
        if self.how == "nan":
            stress[over] = np.nan


@pytest.mark.parametrize(("how", "words"), [("fails", "the law failed, too far"), ("nan", "the law gives stress")])
def test_a_law_that_fails_ends_the_path_with_status_3(tmp_path, capsys, monkeypatch, how, words):
    monkeypatch.setattr("periporo.materials.registry.load", lambda name: Failing)
    material = written(tmp_path, MATERIAL + f"how: {how}\n", "material.yaml")
    path = written(tmp_path, "time_s,strain_xx\n0,0\n1,1e-3\n2,1.9e-3\n3,3e-3\n4,4e-3\n", "pull.csv")
    assert run(arguments(material, path, "-o", tmp_path / "out")) == 3
    error = capsys.readouterr().err
    assert f"pull, row 3, time 3 s: {words}" in error and "ends before that row" in error
    rows = (tmp_path / "out" / "pull.csv").read_text().splitlines()
    assert len(rows) == 4 and "nan" not in "".join(rows)
    assert float(rows[-1].split(",")[1]) == 1.9e-3
    assert (tmp_path / "out" / "pull_stress_strain.png").exists()


class Cautious(Elastic):
    """Bears no more than 1e-4 of strain at once."""

    def compute_stress(self, stress, strain_increment, state, dt):
        over = np.flatnonzero(np.abs(strain_increment).max(axis=1) > 1e-4)
        if len(over):
            stress[:] = np.nan
            raise StepRefused(over)
        super().compute_stress(stress, strain_increment, state, dt)


@pytest.mark.parametrize("controlled", [False, True])
def test_a_refused_increment_is_halved(controlled):
    law = Cautious(**ELASTIC.model_dump())
    target = np.zeros((2, 6))
    target[1, 3] = 3e4 if controlled else 1e-3
    path = StrainPath("shear", np.arange(2.0), target, np.arange(6) == (3 if controlled else -1))
    result = drive(law, path, 1)
    assert result["stress_xy"][-1] == pytest.approx(3e4, rel=1e-9)
    assert result["strain_xy"][-1] == pytest.approx(1e-3, rel=1e-9)


def test_specimen_of_a_law_whose_strength_scatters(tmp_path):
    """Volume and number are the law's: PEAKI1 of a small specimen is larger by (V_ref/V)^(1/4), and drawn by the id."""
    text = "model: arena\ndo_variability: true\nT1: 0.0\nT2: 0.0\ninitial_saturation: 0.0\n"
    material = written(tmp_path, text, "m.yaml")
    path = written(tmp_path, "time_s,strain_xx,strain_yy,strain_zz\n0,0,0,0\n1,1e-3,1e-3,1e-3\n", "pull.csv")
    strength = []
    for k, options in enumerate((["--volume=1"], ["--volume=1e-4"], ["--volume=1e-4", "--id=7"])):
        assert run(arguments(material, path, "-o", tmp_path / str(k), *options)) == 0
        last = (tmp_path / str(k) / "pull.csv").read_text().splitlines()[-1]
        strength.append(float(last.split(",")[7]))
    draws = [strength_factors(np.full((1, 2), k), np.full(1, 1e-4), 4.0, 4.0, 1e-3, 1)[0] for k in (0, 7)]
    assert strength[1:] == pytest.approx([1000 / 3 * draw for draw in draws], rel=1e-6)
    assert strength[1] / strength[0] == pytest.approx(10.0, rel=1e-6) and strength[2] != strength[1]
    assert run(arguments(material, path, "-o", tmp_path / "none", "--volume=0")) == 2


def test_soil_that_came_apart_closes_before_it_bears():
    """In `drive` as in a run: 1 % of opening and closing leaves sand without stress, and then presses."""
    soil = DruckerPrager.example().model_copy(update={"cohesion": 0.0})
    target = np.outer([0.0, 0.01, 0.0, -0.001], [1, 1, 1, 0, 0, 0]) / 3
    result = drive(soil, StrainPath("apart", np.arange(4.0), target), 10)
    assert result["stress_xx"] == pytest.approx([0.0, 0.0, 0.0, -25e3], abs=1e-6)
    assert result["opened"] == pytest.approx([0.0, 0.01, 0.0, 0.0], abs=1e-15)


def test_prescribed_stress_must_start_at_the_initial_stress(tmp_path):
    file = written(tmp_path, "time_s,stress_xx\n0,-1e3\n1,-2e3\n")
    with pytest.raises(InputError, match="differ from the initial stress 0 Pa"):
        drive(ELASTIC, read_path(file))
    result = drive(ELASTIC, read_path(file), initial_stress=np.array([-1e3, 0, 0, 0, 0, 0]))
    assert result["stress_xx"].tolist() == pytest.approx([-1e3, -2e3])


def test_csv_columns(tmp_path):
    file = written(tmp_path, "# a comment\nstrain_xy, time_s\n0, 0\n\n1e-3, 2.5\n")
    path = read_path(file)
    assert path.name == "path" and path.time.tolist() == [0.0, 2.5]
    assert path.target[1].tolist() == [0, 0, 0, 1e-3, 0, 0] and not path.stress_controlled.any()
    result = drive(ELASTIC, path)
    assert result["stress_xy"][-1] == pytest.approx(2 * MU * 1e-3, rel=1e-13)
    path = read_path(written(tmp_path, "time_s,F12\n0,0\n1,0.5\n"))
    assert path.gradient[1].tolist() == [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]


@pytest.mark.parametrize(
    "text, message",
    [
        ("time_s;strain_xx\n0;0\n1;1\n", "line 1: columns are separated by a semicolon; separate them by commas"),
        ("time_s\tstrain_xx\n0\t0\n1\t1\n", "line 1: columns are separated by a tab"),
        ("time_s,strain_xx,\n0,0,\n1,1,\n", "line 1: the line ends with a comma, as if another column followed"),
        ("time_s,strain_xx\n0,0\n1,1,\n", "line 3: the line ends with a comma"),
        ("time_s,eps_xx\n0,0\n1,1\n", "line 1, eps_xx: unknown column; did you mean 'strain_xx'?"),
        ("t,sigma_zy\n0,0\n1,1\n", "line 1, sigma_zy: unknown column; did you mean 'stress_yz'?"),
        ("time_s,strain_yx\n0,0\n1,0\n", "line 1, strain_yx: unknown column; did you mean 'strain_"),
        ("strain_xx\n0\n1\n", "time_s: this column is missing"),
        ("time_s\n0\n1\n", "no column of strain, stress or F"),
        ("time_s,strain_xx,stress_xx\n0,0,0\n1,0,0\n", "not both"),
        ("time_s,strain_xx,F11\n0,0,1\n1,0,1\n", "cannot be combined"),
        ("time_s,strain_xx,strain_xx\n0,0,0\n1,0,0\n", "stands here twice"),
        ("time_s,strain_xx\n0,0\n1,nan\n", "line 3, strain_xx: 'nan' is not a finite number"),
        ("time_s,strain_xx\n0,0\n1,a\n", "line 3, strain_xx: 'a' is not a finite number"),
        ("time_s,strain_xx\n0,0\n1\n", "line 3: 1 values under 2 columns"),
        ("time_s,strain_xx\n0,0\n# x\n0,1\n", "line 4, time_s: time_s must increase"),
        ("time_s,strain_xx\n0,1e-3\n1,1\n", "line 2: the first row is the start"),
        ("time_s,F11\n0,2\n1,1\n", "line 2: the first row is the start"),
        ("time_s,F11\n0,1\n1,-1\n", "line 3, F: the determinant of F must be positive"),
        ("time_s,strain_xx\n0,0\n", "a header and at least two rows"),
    ],
)
def test_bad_paths_are_refused_with_their_line(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        read_path(written(tmp_path, text))
    assert message in " ".join(str(caught.value).split())


@pytest.mark.parametrize(
    "text, message",
    [
        ("triaxail", "did you mean 'triaxial'"),
        ("no/such/file.csv", "cannot be read: No such file"),
        ("triaxial:strian=1", "strian: unknown option"),
        ("triaxial:strain=-1", "strain: '-1' must be a finite number, positive"),
        ("triaxial:rows=2.5", "rows: must be an integer"),
        ("oedometer:confining=x", "confining: 'x' must be a finite number, at least 0"),
    ],
)
def test_bad_built_in_paths_are_refused(text, message):
    with pytest.raises(InputError) as caught:
        find_path(text)
    assert message in " ".join(str(caught.value).split())


@pytest.mark.parametrize(
    "text, message",
    [
        ("density: 1\n", "model: give the name of the material model, one of "),
        ("model: elastik\n", "Did you mean 'elastic'"),
        (MATERIAL + "shear: 1\n", "line 5, shear: unknown key"),
        (MATERIAL.replace("1700.0", "yes"), "line 2, density: must be a number"),
        (MATERIAL.replace("1700.0", "-1"), "line 2, density: must be greater than 0"),
        (MATERIAL.replace("1700.0", ".nan"), "line 2, density"),
        (MATERIAL + "density: 2\n", "line 5, density: this key stands here twice"),
        ("model: elastic\n", "density: this key is missing"),
    ],
)
def test_bad_materials_are_refused_with_their_line(tmp_path, text, message):
    with pytest.raises(InputError) as caught:
        load_material(written(tmp_path, text, "material.yaml"))
    assert message in " ".join(str(caught.value).split())


def arguments(*words):
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return parser.parse_args([str(w) for w in words])


def test_command_writes_the_table_and_the_plots(tmp_path, capsys):
    material = written(tmp_path, MATERIAL, "material.yaml")
    path = written(tmp_path, "time_s,strain_xx\n0,0\n1,1e-3\n2,3e-3\n", "squeeze.csv")
    out = tmp_path / "a" / "b"
    assert run(arguments(material, path, "-o", out, "-n", 3, "--initial-stress=-1e3")) == 0
    header, *rows = (out / "squeeze.csv").read_text().splitlines()
    assert header.startswith(",".join(["time_s", *STRAIN_COLUMNS, *STRESS_COLUMNS]))
    expected = drive(load_material(material), read_path(path), 3, np.array([-1e3, -1e3, -1e3, 0, 0, 0]))
    table = np.array([[float(v) for v in row.split(",")] for row in rows])
    np.testing.assert_array_equal(table, np.stack(list(expected.values()), axis=1))
    assert table[-1, 7] == pytest.approx(-1e3 + (K + 4 / 3 * MU) * 3e-3, rel=1e-12)
    plots = {"squeeze_stress_strain.png", "squeeze_stress_path.png", "squeeze_volume.png"}
    assert {f.name for f in out.iterdir()} == plots | {"squeeze.csv"}
    assert str(out / "squeeze.csv") in capsys.readouterr().out


def test_command_without_matplotlib_writes_the_table_and_a_note(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    material = written(tmp_path, MATERIAL, "material.yaml")
    assert run(arguments(material, "isotropic:rows=3", "-o", tmp_path / "out")) == 0
    assert [f.name for f in (tmp_path / "out").iterdir()] == ["isotropic.csv"]
    assert "need matplotlib" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, message",
    [
        (["-n", 0], "substeps"),
        (["--initial-stress=1,2"], "one number or six"),
        (["--initial-stress=a"], "one number or six"),
    ],
)
def test_command_reports_bad_arguments_with_status_2(tmp_path, capsys, words, message):
    material = written(tmp_path, MATERIAL, "material.yaml")
    assert run(arguments(material, "isotropic", "-o", tmp_path / "out", *words)) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_plots_of_a_law_with_pore_pressure_and_yield_surface(tmp_path):
    from periporo.materials.laboratory.plots import draw_plots

    columns = drive(RememberedStress(), built_in_path("simple_shear", "rows=3"))
    names = [f.name for f in draw_plots(RememberedStress(), columns, tmp_path, "s")]
    assert names == [f"s_{n}.png" for n in ("stress_strain", "stress_path", "volume", "shear", "pore_pressure")]
    columns = drive(CLAY, built_in_path("isotropic", "rows=3"))
    assert len(draw_plots(CLAY, columns, tmp_path, "c")) == 3
    assert all((tmp_path / name).stat().st_size > 5000 for name in names)
