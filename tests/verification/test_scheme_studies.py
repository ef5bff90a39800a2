"""The studies behind docs/explanation/schemes on small blocks: spectra, dispersion, and the table of accuracy."""

import numpy as np
import pytest

from benchmarks import dispersion, schemes_accuracy, stability


def test_spectra_tell_stable_schemes_from_the_published_one():
    for scheme in ("bond_projected", "point_state", "point_state, sharpened", "sub_horizon", "standard", "published"):
        sim = stability.block((8, 6), scheme, "cubic", 2.2, 0.2)
        found = stability.figures(sim, stability.operator(sim))
        assert found["zero_modes"] == 3, scheme
        if scheme == "published":
            assert found["growth"] > 1e-3 and found["asymmetry"] > 0.05
        else:
            assert found["growth"] == 0.0 and found["asymmetry"] < 1e-13 and found["lowest"] > 1e-3, scheme
            assert found["chosen_step"] == pytest.approx(found["stable_step"], rel=0.02)


def test_a_free_block_keeps_its_energy_or_bursts():
    _, energy = stability.free_flight("point_state, sharpened", (14, 9), "cubic", 2.2, 0.0, 400)
    assert 0.2 < energy.min() <= energy.max() < 0.8
    step, energy = stability.free_flight("published", (14, 9), "constant", 2.1, 0.0, 400)
    assert energy[-1] > 1e6 and step[-1] < 400


def test_dispersion_is_that_of_the_moments():
    """Long waves: 1 - O(k^2) of the energy-consistent schemes, 1 - O(k^4) sharpened, a wrong limit as published."""
    speeds = dispersion.phase_speeds
    for scheme in ("bond_projected", "point_state", "standard"):
        errors = 1.0 - speeds(scheme, "cubic", 2.2, (20, 40))
        assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05) and errors[0] < 0.02, scheme
    assert np.abs(1.0 - speeds("point_state, sharpened", "cubic", 2.2, (20, 40))).max() < 1e-3
    assert speeds("published", "cubic", 2.2, (80,))[0] == pytest.approx(np.sqrt(0.924), abs=2e-3)


def test_accuracy_is_kept_in_files_and_tabulated(tmp_path, capsys):
    words = ["--quick", "--only", "V7", "--scheme", "standard", "--folder", str(tmp_path)]
    for _ in range(2):  # the second time from its file
        with pytest.raises(SystemExit):
            schemes_accuracy.main(words)
    assert capsys.readouterr().out.count(".json") == 1
    rows = [line.split("|")[1:-1] for line in (tmp_path / "schemes_accuracy.md").read_text().splitlines()]
    column = [cell.strip() for cell in rows[0]].index("standard")
    figures = {row[1].strip(): row[column].strip() for row in rows[2:]}
    assert float(figures["order of the settlement"]) == pytest.approx(1.0, abs=0.05)
    assert figures["settlement at 40 rows"] == "**0.024**"
