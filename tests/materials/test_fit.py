"""Fits: parameters from synthetic noisy tests within their confidence, AGS4 files, and what is refused."""

import numpy as np
import pytest
import yaml

import periporo
from periporo import InputError
from periporo.core import cli
from periporo.materials.laboratory.files import read_ags, write_table

CLAY = {
    "model": "cam_clay", "grain_density": 2700.0, "porosity": 0.45, "bulk_modulus": 8e6, "shear_modulus": 5e6,
    "critical_state_slope": 1.05, "compression_index": 0.08, "swelling_index": 0.01,
}  # fmt: skip
SAND = {"model": "mohr_coulomb", "density": 1700.0, "bulk_modulus": 20e6, "shear_modulus": 12e6, "cohesion": 20e3,
        "friction_angle": 33.0, "dilation_angle": 6.0}  # fmt: skip


def noisy(columns, names, seed, share=0.015):
    """Some columns with noise of a share of their range."""
    rng = np.random.default_rng(seed)
    return {n: v + share * np.ptp(v) * rng.normal(size=len(v)) * (n != "axial_strain") for n in names
            for v in [columns[n][1:]]}  # fmt: skip


def measured(folder, material, tests, names, over="axial_strain"):
    """Entries of `tests` with noisy curves that the material gives."""
    entries = []
    for k, test in enumerate(tests):
        write_table(folder / f"lab{k}.csv", noisy(periporo.drive(material, test), [over, *names[k]], k))
        entries.append({"test": test, "measured": str(folder / f"lab{k}.csv"), "over": over, "compare": names[k]})
    return entries


def check_found(fit, truth):
    """Within 3 %, and within twice the 95 % interval that it says, which must be a narrow one."""
    for name, value in fit.values.items():
        assert value == pytest.approx(truth[name], rel=0.03), name
        assert abs(value - truth[name]) < 2 * fit.confidence[name] < 0.1 * truth[name], name


def triaxial(pressure, **keys):
    return {"pressure": pressure, "substeps": 2,
            "phases": [{"type": "triaxial", "strain": 0.15, "rows": 15, **keys}]}  # fmt: skip


def test_cam_clay_from_three_noisy_tests(tmp_path):
    """Drained, undrained, and compression without lateral strain; begun 20 to 40 % off."""
    oedometer = {"pressure": 2e4, "phases": [{"type": "oedometer", "strain": 0.12, "rows": 15}], "substeps": 2}
    tests = [triaxial(1e5), triaxial(2e5, drainage="undrained"), oedometer]
    names = [["q", "volumetric_strain"], ["q", "pore_pressure"], ["axial_stress"]]
    begun = CLAY | {"critical_state_slope": 0.8, "compression_index": 0.11, "shear_modulus": 6.5e6}
    wanted = dict.fromkeys(["critical_state_slope", "compression_index", "shear_modulus"])
    fit = periporo.fit(begun, {"parameters": wanted, "tests": measured(tmp_path, CLAY, tests, names)})
    check_found(fit, CLAY)
    assert fit.misfit == pytest.approx(0.015, rel=0.35)  # the noise
    assert fit.material.compression_index == fit.values["compression_index"]


def test_mohr_coulomb_from_three_noisy_tests_by_the_command_line(tmp_path, monkeypatch, capsys):
    """Cohesion, friction and dilation, begun 15 to 65 % off."""
    monkeypatch.chdir(tmp_path)
    entries = measured(tmp_path, SAND, [triaxial(p) for p in (5e4, 1e5, 2e5)], [["q", "volumetric_strain"]] * 3)
    begun = SAND | {"friction_angle": 28.0, "cohesion": 30e3, "dilation_angle": 2.0}
    (tmp_path / "sand.yaml").write_text(yaml.safe_dump(begun))
    wanted = {"friction_angle": {"highest": 45.0}, "cohesion": None, "dilation_angle": None}
    (tmp_path / "lab.yaml").write_text(yaml.safe_dump({"parameters": wanted, "tests": entries}))
    assert cli.main(["fit", "sand.yaml", "lab.yaml"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    printed = {row[0]: (float(row[1]), float(row[3])) for row in rows if "+-" in row}
    found = yaml.safe_load((tmp_path / "fit" / "material.yaml").read_text())
    for name in wanted:
        assert found[name] == pytest.approx(SAND[name], rel=0.03), name
        value, interval = printed[name]
        assert abs(value - SAND[name]) < 2 * interval < 0.1 * SAND[name], name
    assert (tmp_path / "fit" / "test_2_stress_strain.png").exists()


def test_confidence_follows_the_scatter_of_each_curve(tmp_path):
    """A rough curve of q tells friction, a fine one of volume dilation: each as well as its curve is known."""
    (entry,) = measured(tmp_path, SAND, [triaxial(1e5)], [["q", "volumetric_strain"]])
    exact, rng = periporo.drive(SAND, triaxial(1e5)), np.random.default_rng(0)
    table = {name: exact[name][1:] for name in ("axial_strain", "q", "volumetric_strain")}
    for name, share in (("q", 0.05), ("volumetric_strain", 0.001)):
        table[name] = table[name] + share * np.ptp(exact[name]) * rng.normal(size=15)
    write_table(entry["measured"], table)
    begun = SAND | {"friction_angle": 28.0, "dilation_angle": 4.0}
    fit = periporo.fit(begun, {"parameters": {"friction_angle": None, "dilation_angle": None}, "tests": [entry]})
    for name, least, most in (("friction_angle", 0.008, 0.05), ("dilation_angle", 0.001, 0.012)):
        assert least < fit.confidence[name] / SAND[name] < most
        assert abs(fit.values[name] - SAND[name]) < 2 * fit.confidence[name]


AGS = '''"GROUP","TRET"
"HEADING","LOCA_ID","TRET_TESN","TRET_CELL","TRET_DEVF","TRET_STRN"
"UNIT","","","kPa","kPa","%"
"TYPE","ID","X","0DP","0DP","1DP"
"DATA","BH1","1","100","{0:.1f}","12.0"
"DATA","BH1","2","200","{1:.1f}","13.5"
"DATA","BH2","1","200","failed","2.0"
'''


def test_values_at_failure_from_an_ags_file(tmp_path):
    """Two specimens of a borehole: cohesion and friction follow from the deviator at failure at two pressures."""
    tests = [triaxial(p) for p in (1e5, 2e5)]
    peaks = [periporo.drive(SAND, test)["q"].max() for test in tests]
    file = tmp_path / "lab.ags"
    file.write_text(AGS.format(*(peak / 1e3 for peak in peaks)).replace("\n", "\r\n"))
    columns = {"q": "TRET_DEVF", "axial_strain": "TRET_STRN"}
    table = read_ags(file, "TRET", columns, {"LOCA_ID": "BH1"})
    np.testing.assert_allclose(table["q"], peaks, atol=50.0)
    np.testing.assert_allclose(table["axial_strain"], [0.12, 0.135])
    assert np.isnan(read_ags(file, "TRET", columns, {"LOCA_ID": "BH2"})["q"][0])
    ags = [{"group": "TRET", "columns": columns, "where": {"LOCA_ID": "BH1", "TRET_TESN": n}} for n in "12"]
    entries = [{"test": t, "measured": str(file), "ags": a, "compare": ["q"]} for t, a in zip(tests, ags, strict=True)]
    fit = periporo.fit(SAND | {"friction_angle": 25.0}, {"parameters": {"friction_angle": None}, "tests": entries})
    assert fit.values["friction_angle"] == pytest.approx(33.0, rel=1e-3)
    with pytest.raises(InputError, match="no group 'TRIT'.*TRET"):
        read_ags(file, "TRIT", columns, {})


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"parameters": {"frictoin_angle": None}}, "no number of this name(.|\\n)*'friction_angle'"),
        ({"parameters": {"report_dissipation": None}}, "no number of this name"),
        ({"parameters": {"cohesion": {"start": -1.0}}}, "not between 0 and"),
        ({"parameters": {"density": None}}, "nothing that is compared depends on it"),
        ({"compare": ["u"]}, "has\\s+no\\s+column\\s+'u'"),
        ({"measured": "no.csv"}, "cannot be read"),
    ],
)
def test_bad_fits_are_refused(tmp_path, changes, words):
    (entry,) = measured(tmp_path, SAND, [triaxial(1e5)], [["q"]])
    wanted = changes.pop("parameters", {"friction_angle": None})
    with pytest.raises(InputError, match=words):
        periporo.fit(SAND, {"parameters": wanted, "tests": [entry | changes]})
