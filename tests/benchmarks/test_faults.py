"""Pages that say what holds a promise name tests that exist; every row of theirs stands on its page."""

import re

import pytest

from benchmarks import ROOT, faults, soil_laws

NUMBERS = {"A": 14, "B": 0, "C": 13, "D": 0, "E": 13}  # rows of each letter; those of B and D have none


HELD = re.compile(r"`(\w+(?:/\w+)*\.py)(?: -k (?:'([^']+)'|(\w+)))?`")  # a file of tests, a part of names
LEAST = {"ground": 50, "water": 35, "flow": 25, "speed": 15}  # tests that a page of promises names
PROMISES = [(faults.PAGE.with_name(f"{name}_promises.md"), "", least) for name, least in LEAST.items()]


def named(page):
    """The tests that a page names."""
    return {(file, quoted or word) for file, quoted, word in HELD.findall(" ".join(page.read_text().split()))}


@pytest.mark.parametrize(
    ("page", "folder", "least"), [(faults.PAGE, "", 50), *PROMISES, (soil_laws.PAGE, "materials", 15)]
)
def test_every_test_that_a_page_names_exists(page, folder, least):
    tests = named(page)
    assert len(tests) >= least
    for file, words in tests:
        names = re.findall(r"def (test_\w+)", (ROOT / "tests" / folder / file).read_text())
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
