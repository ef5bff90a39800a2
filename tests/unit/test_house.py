"""The house as installed: every folder is shipped, and what packages offer is what type checkers are told."""

import ast
import re
import sys
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_every_room_is_shipped():
    rooms = {path.parent.relative_to(ROOT) for top in ("core", "contact", "io", "materials", "configs")
             for path in (ROOT / top).rglob("__init__.py")}  # fmt: skip
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    assert {"periporo", *(f"periporo.{'.'.join(room.parts)}" for room in rooms)} == set(packages)


def test_the_page_on_architecture_has_the_rooms_that_the_linter_holds_in_their_order():
    page = (ROOT / "docs" / "explanation" / "architecture.md").read_text()
    told = [name.removesuffix(".py") for name in re.findall(r"^\| `([\w/.]+?)/?` \|", page, re.M)]
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    floors = {c["containers"][0]: [set(f.split(" | ")) for f in c["layers"]] for c in contracts if "layers" in c}
    for house in ("core", "io"):
        rooms = [name.partition("/")[2] for name in told if name.startswith(f"{house}/")]
        for floor in reversed(floors[f"periporo.{house}"]):
            assert set(rooms[: len(floor)]) == floor
            rooms = rooms[len(floor) :]
        assert not rooms


@pytest.mark.parametrize("package", ["periporo", "periporo.materials"])
def test_names_that_are_offered_are_those_that_type_checkers_see(package):
    module = import_module(package)
    tree = ast.parse(Path(module.__file__).read_text())
    (branch,) = [node for node in tree.body if isinstance(node, ast.If)]
    told = {alias.name: node.module for node in branch.body for alias in node.names}
    assert set(told) == set(module.__all__) <= set(dir(module))
    for name, place in told.items():
        assert getattr(module, name) is getattr(sys.modules[place], name)
