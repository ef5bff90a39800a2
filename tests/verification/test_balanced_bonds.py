"""The benchmark `balanced_bonds` at small size: tilted bonds make a cloud as accurate as a grid."""

import numpy as np
import pytest

from benchmarks import balanced_bonds


def test_tilted_bonds_balance_and_halve_the_error_of_a_cloud(capsys):
    balanced_bonds.main(["--quick"])
    rows = {cells[0]: np.array(cells[1:], float) for cells in table(capsys.readouterr().out)}
    as_it_is, tilt, twenty = rows["as it is"], rows["tilt"], rows["tilt, 20"]
    assert as_it_is[1] > 1.8 * tilt[1] and tilt[2] > 1.8  # the error on 16 cells, the order
    assert as_it_is[3] > 0.1 and tilt[3] < 1e-12 and twenty[3] < 0.02 * as_it_is[3]  # imbalance
    assert rows["weights"][3] < 1e-10 and rows["weights"][4] < 0.5  # at the price of shares that are far from equal
    grid = balanced_bonds.Cloud(16, 0.0)
    assert tilt[1] == pytest.approx(grid.error(grid.share, grid.gradient(grid.normal)), rel=0.25)


def table(text):
    """The cells of every row of the table in a text, without its head."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[1:]]
