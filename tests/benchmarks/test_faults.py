"""Pages whose rows are held by tests: those exist, and every row stands on its page."""

import re

import pytest

from benchmarks import ROOT, faults, soil_laws

NUMBERS = {"A": 14, "B": 0, "C": 13, "D": 0, "E": 13}  # rows of each letter; those of B and D have none


HELD = {t for row in faults.ROWS if not callable(row.how) for t in row.how}
HELD |= {f"materials/{row.test}" for row in soil_laws.ROWS}


@pytest.mark.parametrize("test", sorted(HELD))
def test_every_test_that_holds_a_row_exists(test):
    file, _, words = test.partition("::")
    names = re.findall(r"def (test_\w+)", (ROOT / "tests" / file).read_text())
    for word in words.split(" or "):
        assert any(word in name for name in names), f"no test of {file} has '{word}' in its name"


def test_every_row_is_held_by_something_and_stands_on_the_page():
    page = " ".join(faults.PAGE.read_text().split())
    for row in faults.ROWS:
        for part in " ".join(row.entry("FOUND").split()).split("FOUND"):
            assert part in page, row.name
    wanted = {f"{letter}{k}" for letter, last in NUMBERS.items() for k in range(1, last + 1)} | {"B", "D"}
    assert {row.name for row in faults.ROWS} == wanted


def test_every_closed_form_of_soils_stands_on_its_page_and_is_met():
    """As it was measured last: `python -m benchmarks soil_laws`."""
    page = " ".join(soil_laws.PAGE.read_text().split())
    for row in soil_laws.ROWS:
        before, after = map(re.escape, " ".join(row.entry("FOUND").split()).split("FOUND"))
        (found,) = re.findall(before + r"([^\s,]+)" + after, page)
        assert float(found) <= row.bound
