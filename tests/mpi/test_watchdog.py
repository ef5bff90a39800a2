"""The watchdog on several ranks: they see a fault alike, take it back alike, and report it alike."""

from itertools import product

import h5py
import numpy as np
import pytest
import yaml

FAULTS = {  # kind -> text of the message
    "nan": "point 17 at (", "nan_stress": "is not a number", "speed": "times the wave speed",
    "strain": "within one step", "energy": "energy error of",
    "refused": "point 17 at (",
}  # fmt: skip
LASTING = ("nan", "speed")
DURATION = 2.6e-3  # s, 130 steps


@pytest.fixture(scope="module")
def spoiled(launch, by_folder, scene_of, tmp_path_factory):
    """What blocks that fall on one rank and on two say by kind of fault, and the folder of the runs, `on1` and `on2`.

    A kind is "nan", which comes once, or "nan again", which comes again and again.
    """
    parent = tmp_path_factory.mktemp("spoiled")
    for ranks, kind in product((1, 2), (*FAULTS, *(f"{kind} again" for kind in LASTING))):
        # links of points would feel the leap of the fault `strain`, too
        bonds = {"correspondence": "bond_projected"} if kind == "strain" else {}
        scene = scene_of(counts=(8, 6), contacts=[], time_step={"fixed": 2e-5}, output={"interval": DURATION / 2},
                         stages=[{"name": "fall", "type": "dynamics", "duration": DURATION}], **bonds)  # fmt: skip
        scene["bodies"][0]["velocity"] = [0.3, 0.0]
        folder = parent / f"on{ranks}" / kind
        folder.mkdir(parents=True)
        (folder / "scene.yaml").write_text(yaml.safe_dump(scene))
    runs = [launch(ranks, "spoiled", "--no-plot", folder=parent / f"on{ranks}") for ranks in (1, 2)]
    assert [run.returncode for run in runs] == [3, 3], runs[1].stderr  # of those whose fault lasts
    return [(by_folder(run.stdout), by_folder(run.stderr)) for run in runs], parent


def watchdog_messages(text):
    """The lines that tell of a fault or of a repair."""
    return [line for line in text.splitlines() if "Likely cause" in line or "back to step" in line or "sound" in line]


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_seen_and_repaired_alike(spoiled, kind):
    ((alone, _), (together, _)), folder = spoiled
    messages = watchdog_messages(alone[kind])
    assert watchdog_messages(together[kind]) == messages and len(messages) >= 2
    seen = {"refused": "step 32", "energy": "step 120"}.get(kind, "step 40")  # refusals do not wait
    assert FAULTS[kind] in messages[0] and seen in messages[0] and "back to step 0 with 0.5" in messages[1]
    assert kind != "refused" or "refuses the step (Elastic: it is tired)" in messages[0]
    one, two = (folder / f"on{ranks}" / kind / "scene.vtkhdf" for ranks in (1, 2))
    with h5py.File(one) as a, h5py.File(two) as b:
        assert a["Run"].attrs["retries"] == b["Run"].attrs["retries"] == 1
        assert np.array_equal(a["VTKHDF/Points"][:], b["VTKHDF/Points"][:])
        assert np.isfinite(a["VTKHDF/Points"][:]).all() and a["History/time"][-1] == pytest.approx(DURATION, rel=1e-9)


@pytest.mark.parametrize("kind", LASTING)
def test_a_lasting_fault_ends_in_the_same_report(spoiled, kind):
    ((_, alone), (_, together)), folder = spoiled
    kind += " again"
    assert alone[kind].strip() == together[kind].strip() and "Traceback" not in alone[kind]
    for word in ("t = ", "step 31", "point 17 at (", "material 'soil'", "Likely cause", "3 repairs were tried"):
        assert word in alone[kind], alone[kind]
    folders = [folder / f"on{ranks}" / kind for ranks in (1, 2)]
    reports = [(where / "scene.diagnostic.csv").read_text() for where in folders]
    assert reports[0] == reports[1] and len(reports[0].splitlines()) > 5
    with h5py.File(folders[1] / "scene.vtkhdf") as file:  # what was recorded before stays readable
        assert file["VTKHDF/Steps"].attrs["NSteps"] >= 1
