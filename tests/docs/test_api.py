"""The API reference: it has every public name, and the examples in its docstrings are run."""

import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

import periporo
import periporo.materials

PAGES = (Path(__file__).parents[2] / "docs" / "reference" / "api").glob("*.md")
KINDS = {n: k for page in PAGES for k, n in re.findall(r"^\.\. auto(\w+):: (\S+)", page.read_text(), re.M)}
NAMES = [name for name, kind in KINDS.items() if kind != "data"]
WITH_EXAMPLES = ("run", "Simulation", "InputError", "check_material", "drive", "built_in_path", "to_matrix")


def found(name):
    """What a dotted name stands for."""
    module, _, attribute = name.rpartition(".")
    return getattr(importlib.import_module(module), attribute)


def public_members(thing):
    """A class, and its methods and properties that carry no underscore; or a function alone."""
    yield thing
    if inspect.isclass(thing):
        for name, member in vars(thing).items():
            if not name.startswith("_") and (inspect.isroutine(member) or isinstance(member, property)):
                yield member


def test_every_public_name_is_in_the_reference():
    offered = {f"{package.__name__}.{name}" for package in (periporo, periporo.materials) for name in package.__all__}
    assert offered <= set(KINDS)


@pytest.mark.parametrize("name", NAMES)
def test_every_name_is_explained(name):
    for member in public_members(found(name)):
        assert inspect.getdoc(member), f"{name}: {member} has no docstring"


@pytest.mark.parametrize("name", NAMES)
def test_examples_in_docstrings(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    thing = found(name)
    own, names = name.rpartition(".")[2], vars(importlib.import_module(thing.__module__)).copy()
    tests = [test for test in doctest.DocTestFinder().find(thing, own, module=False, globs=names) if test.examples]
    assert tests or own not in WITH_EXAMPLES
    for test in tests:
        said = []
        result = doctest.DocTestRunner().run(test, out=said.append)
        assert result.failed == 0, "".join(said)
