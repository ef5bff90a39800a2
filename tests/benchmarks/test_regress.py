"""Speed followed by commit: what counts as a change, versions side by side, and the table that is kept."""

import numpy as np
import pytest

from benchmarks import regress
from benchmarks.library import speed_table, workload
from benchmarks.library.versions import CHECKOUT, Process, VersionError, lay_out, name_of

TURNS = 24


def ratios(middle, spread):
    """Ratios that scatter evenly about `middle`."""
    return middle + spread * np.linspace(-1.0, 1.0, TURNS)


@pytest.mark.parametrize("middle, spread, said", [
    (1.0, 0.02, ""), (1.02, 0.001, ""), (0.98, 0.001, ""), (1.05, 0.02, "slower"), (0.95, 0.02, "faster"),
    (1.05, 0.2, ""), (0.95, 0.2, ""),
])  # fmt: skip
def test_a_change_is_larger_than_three_per_cent_and_than_its_scatter(middle, spread, said):
    assert regress.verdict(ratios(middle, spread)) == said


def test_what_is_slower_is_named(capsys):
    a = np.full(TURNS, 2e-3)
    samples = {"cam_clay: material": np.stack([a, 1.1 * a], 1), "column of clay": np.stack([a, 0.9 * a], 1)}
    assert regress.report(samples) == ["slower", "faster"]
    said = capsys.readouterr().out
    assert "slower by more than 3 %: cam_clay: material" in said and "faster by more than 3 %: column of clay" in said
    assert "2.000    2.200   1.100 (1.100-1.100) slower" in said


def test_there_are_a_dozen_kernels_and_five_scenes_in_the_order_of_the_workload():
    names = [f"{name}: {part}" for name, (_, parts) in workload.KERNELS.items() for part in parts]
    assert len(names) >= 12 and len(workload.SCENES) == 5
    assert sorted([*workload.SCENES, *names], key=regress.place) == [*names, *workload.SCENES]


@pytest.mark.parametrize("name", ["plane", "column of sand"])
def test_the_workload_shows_its_measurements(name):
    seconds = workload.measure(name)
    expected = [f"{name}: {part}" for part in workload.KERNELS[name][1]] if name in workload.KERNELS else [name]
    assert list(seconds) == expected and min(seconds.values()) > 0.0


def test_a_process_runs_its_version_and_says_what_that_lacks(tmp_path, capfd):
    folder = lay_out(CHECKOUT, tmp_path / "B")
    with Process(folder) as process:
        assert process.measure("nothing of this name") == {}
    assert capfd.readouterr().err.startswith("B: InputError")
    entries = (next(folder.glob("*.dist-info")) / "entry_points.txt").read_text()
    assert "[periporo.materials]" in entries and "cam_clay = " in entries


def test_a_version_that_does_not_exist_is_refused():
    assert name_of(CHECKOUT) == CHECKOUT
    with pytest.raises(VersionError):
        name_of("no-such-commit")
    with pytest.raises(SystemExit):
        regress.main([])


def test_the_table_keeps_ratios_by_commit(tmp_path):
    file, a = tmp_path / "speed.csv", np.full(TURNS, 1e-3)
    assert "nothing is kept" in speed_table.lines(file)[0]
    speed_table.append("aaa", "bbb", {"k": np.stack([a, 1.04 * a], 1), "l": np.stack([a, a], 1)}, file)
    speed_table.append("aaa", "ccc", {"k": np.stack([a, 0.5 * a], 1)}, file)
    assert speed_table.lines(file) == [
        "| measurement | bbb / aaa | ccc / aaa |", "|---|---|---|", "| k | 1.0400 | 0.5000 |", "| l | 1.0000 |  |",
    ]  # fmt: skip
