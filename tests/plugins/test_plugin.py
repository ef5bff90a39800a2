"""A law from another package: installed by pip, found by name, checked by the kit, driven like any other."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("setuptools", minversion="70.1", reason="pip needs it to build without a network")

SOURCE = Path(__file__).parent / "periporo_mohr_coulomb"

PROBE = """
import json
import sys

import numpy as np

from periporo.materials import built_in_path, check_material, drive, read_path, registry



def turned_fibre(law):
    # direction of the fibres after a quarter turn with shear, and that of the material line
    times = np.linspace(0, 1, 61)
    paths = []
    for t in times:
        c, s = np.cos(np.pi / 2 * t), np.sin(np.pi / 2 * t)
        paths.append(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array([[1, 0.3 * t, 0], [0, 1, 0], [0, 0, 1]]))
    columns = "time_s F11 F12 F13 F21 F22 F23 F31 F32 F33"
    table = np.column_stack([times, np.reshape(paths, (61, 9))])
    np.savetxt("turn.csv", table, header=columns.replace(" ", ","), delimiter=",", comments="")
    result = drive(law, read_path("turn.csv"))
    line = paths[-1] @ np.array(law.direction)
    told = paths[-1] @ np.linalg.inv(paths[-2])  # the law hears of the last turn when it is called again
    u, _, v = np.linalg.svd(told)
    fibre = u @ v @ [result[f"fibre_{a}"][-1] for a in "xyz"]
    return [fibre.tolist(), (line / np.linalg.norm(line)).tolist()]


found = {}
laws = {name: registry.load(name).example() for name in ("mohr_coulomb_numpy", "mohr_coulomb_numba")}
for name, law in laws.items():
    found[name] = [check_material(law, dimension).cycle_energy for dimension in (2, 3)]
    result = drive(law, built_in_path("triaxial", "confining=2e4,strain=0.02,rows=5"))
    found[name].append(-result["stress_yy"][-1])

fibres = registry.load("fibres").example()
found["fibres"] = [check_material(fibres, dimension).cycle_energy for dimension in (2, 3)]
found["fibre"] = turned_fibre(fibres.model_copy(update={"direction": (1.0, 2.0, 0.5)}))

rng = np.random.default_rng(5)
increment = rng.normal(size=(4000, 6)) * 10 ** rng.uniform(-6, -2, (4000, 1))
stresses = []
for law in laws.values():
    stress = np.zeros((4000, 6))
    stress[:, :3] = -rng.uniform(0, 0, 1) - 1e4
    law.compute_stress(stress, increment, np.zeros((4000, 1)), 1.0)
    stresses.append(stress)
found["difference"] = float(np.abs(stresses[0] - stresses[1]).max() / np.abs(stresses[0]).max())
principal = np.linalg.eigvalsh(stresses[1][:, [0, 3, 5, 3, 1, 4, 5, 4, 2]].reshape(-1, 3, 3))
sine, cosine = 0.5, np.sqrt(0.75)
excess = principal[:, 2] * (1 + sine) - principal[:, 0] * (1 - sine) - 2 * 1e3 * cosine
found["excess"] = float(excess.max() / np.abs(stresses[0]).max())
gap = np.abs(np.diff(principal, axis=1)) < 1e-6 * np.abs(principal).max()
found["edges"] = [int(gap[:, 0].sum()), int(gap[:, 1].sum()), int(gap.all(axis=1).sum())]
json.dump(found, sys.stdout)
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Environment in which the plugin is installed, in a folder of its own."""
    folder = tmp_path_factory.mktemp("plugin")
    source, target = folder / "source", folder / "site"
    shutil.copytree(SOURCE, source)
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--quiet",
    ]
    subprocess.run([*pip, "--target", str(target), str(source)], check=True, timeout=120)
    return os.environ | {"PYTHONPATH": str(target), "PERIPORO_CACHE": str(folder / "cache")}


def test_the_laws_are_short():
    for name in ("with_numpy.py", "with_numba.py", "fibres.py"):
        assert len((SOURCE / "periporo_mohr_coulomb" / name).read_text().splitlines()) < 80


def test_plugin_is_found_conforms_and_fails_where_it_should(installed, tmp_path):
    """Triaxial strength at 20 kPa: (s3 (1 + sin phi) + 2 c cos phi)/(1 - sin phi), in both loops."""
    run = subprocess.run(
        [sys.executable, "-c", PROBE],
        env=installed,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    strength = 3 * 2e4 + 2 * 1e3 * 3**0.5
    for name in ("mohr_coulomb_numpy", "mohr_coulomb_numba"):
        energy_2d, energy_3d, axial = found[name]
        assert energy_2d > 0 and energy_3d > 0
        assert axial == pytest.approx(strength, rel=1e-9)
    assert max(map(abs, found["fibres"])) < 3e-3  # elastic, but that fibres turn with strains of 1e-4
    assert found["fibre"][0] == pytest.approx(found["fibre"][1], abs=2e-4)
    assert found["difference"] < 1e-10
    assert found["excess"] < 1e-10
    assert all(count > 20 for count in found["edges"])


def test_unknown_name_lists_the_plugin(installed, tmp_path):
    probe = "from periporo.materials import registry\nregistry.load('mohr_colomb_numba')"
    run = subprocess.run(
        [sys.executable, "-c", probe], env=installed, cwd=tmp_path, capture_output=True, text=True, timeout=60
    )
    assert "Did you mean 'mohr_coulomb_numba'?" in run.stderr
