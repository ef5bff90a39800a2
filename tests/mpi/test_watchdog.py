"""The watchdog on several ranks: they see a fault alike, take it back alike, and report it alike."""

from pathlib import Path

import h5py
import numpy as np
import pytest
import yaml

HERE = Path(__file__).parent
FAULTS = {  # kind -> text of the message
    "nan": "point 17 at (", "nan_stress": "is not a number", "speed": "times the wave speed",
    "strain": "within one step", "energy": "energy error of",
    "refused": "point 17 at (",
}  # fmt: skip


@pytest.fixture
def spoil(mpirun, scene_of, tmp_path):
    """Function that runs a falling block on a number of ranks, spoiled so many times: process, folder."""
    scene = scene_of(counts=(8, 6), contacts=[], time_step={"fixed": 2e-5}, output={"interval": 2e-3},
                     stages=[{"name": "fall", "type": "dynamics", "duration": 6e-3}])  # fmt: skip
    scene["bodies"][0]["velocity"] = [0.3, 0.0]

    def run(ranks, kind, times, step):
        folder = tmp_path / f"on{ranks}"
        folder.mkdir()
        bonds = {"correspondence": "bond_projected"} if kind == "strain" else {}  # links of points would feel it, too
        (folder / "scene.yaml").write_text(yaml.safe_dump(scene | bonds))
        words = (HERE / "spoiled.py", kind, step, times, "scene.yaml", "--no-plot")
        return mpirun(ranks, *words, folder=folder, timeout=200), folder

    return run


def watchdog_messages(text):
    """The lines that tell of a fault or of a repair."""
    return [line for line in text.splitlines() if "Likely cause" in line or "back to step" in line or "sound" in line]


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_seen_and_repaired_alike(spoil, kind):
    (alone, one), (together, two) = spoil(1, kind, 1, 141), spoil(2, kind, 1, 141)
    assert alone.returncode == together.returncode == 0, together.stderr
    messages = watchdog_messages(alone.stdout)
    assert watchdog_messages(together.stdout) == messages and len(messages) >= 2
    seen = "step 142" if kind == "refused" else "step 150"  # a refusal does not wait for the next look
    assert FAULTS[kind] in messages[0] and seen in messages[0] and "back to step 0 with 0.5" in messages[1]
    assert kind != "refused" or "refuses the step (Elastic: it is tired)" in messages[0]
    with h5py.File(one / "scene.vtkhdf") as a, h5py.File(two / "scene.vtkhdf") as b:
        assert a["Run"].attrs["retries"] == b["Run"].attrs["retries"] == 1
        assert np.array_equal(a["VTKHDF/Points"][:], b["VTKHDF/Points"][:])
        assert np.isfinite(a["VTKHDF/Points"][:]).all() and a["History/time"][-1] == pytest.approx(6e-3, rel=1e-9)


@pytest.mark.parametrize("kind", ["nan", "speed"])
def test_a_lasting_fault_ends_in_the_same_report(spoil, kind):
    (alone, one), (together, two) = spoil(1, kind, 99, 31), spoil(2, kind, 99, 31)
    assert alone.returncode == together.returncode == 3
    assert alone.stderr.strip() == together.stderr.strip() and "Traceback" not in alone.stderr
    for word in ("t = ", "step 31", "point 17 at (", "material 'soil'", "Likely cause", "3 repairs were tried"):
        assert word in alone.stderr, alone.stderr
    reports = [(folder / "scene.diagnostic.csv").read_text() for folder in (one, two)]
    assert reports[0] == reports[1] and len(reports[0].splitlines()) > 5
    with h5py.File(two / "scene.vtkhdf") as file:  # what was recorded before stays readable
        assert file["VTKHDF/Steps"].attrs["NSteps"] >= 1
