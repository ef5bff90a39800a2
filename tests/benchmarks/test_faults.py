"""The page of inputs that once went wrong: every row names tests that exist, and stands on the page."""

import re

import pytest

from benchmarks import ROOT, faults

NUMBERS = {"A": 14, "B": 0, "C": 13, "D": 0, "E": 13}  # rows of each letter; those of B and D have none


@pytest.mark.parametrize("test", sorted({t for row in faults.ROWS if not callable(row.how) for t in row.how}))
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
