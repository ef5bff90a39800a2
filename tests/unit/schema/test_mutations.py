"""Systematic damage to valid scenes: every mutation is refused in its place, on one screen."""

import importlib.util
import random
from pathlib import Path

import pytest
from pydantic import Field

from periporo.errors import SCREEN_LINES, SCREEN_WIDTH, InputError, dotted
from periporo.io.input.load import load_scene
from periporo.io.input.yaml_source import read_yaml
from periporo.materials.base import LARGEST
from periporo.materials.elastic import Elastic

SCENES = [Path(__file__).with_name(f"{name}.yaml") for name in ("plane", "space")]
_SPEC = importlib.util.spec_from_file_location("mutations", Path(__file__).parents[2] / "mutations.py")
mutations = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(mutations)


def check_refusal(file, text):
    """The problems with a scene `text`, or None if it is valid; any other exception fails the test."""
    file.write_text(text, encoding="utf-8")
    try:
        load_scene(file)
    except InputError as error:
        lines = str(error).splitlines()
        assert 2 <= len(lines) <= SCREEN_LINES and max(map(len, lines)) <= SCREEN_WIDTH
        assert not any(word in str(error) for word in ("Traceback", "pydantic", "Input should"))
        return error.problems
    return None


def related(a, b):
    return a[: len(b)] == b or b[: len(a)] == a


@pytest.mark.parametrize("scene", SCENES, ids=lambda f: f.stem)
def test_every_structural_mutation_is_refused_in_its_place(tmp_path, scene):
    data = read_yaml(scene).data
    cases = list(mutations.structural(data))
    random.Random(1).shuffle(cases)
    assert len(cases) > 400
    for what, path, damaged in cases[:400]:
        text = mutations.dumped(damaged)
        problems = check_refusal(tmp_path / "scene.yaml", text)
        case = f"{dotted(path)} {what}"
        assert problems, f"{case} was accepted"
        assert any(related(p.path, path) for p in problems), f"{case} is reported elsewhere: {problems}"
        if what == "misspelt":
            assert len(problems) == 1, f"{case} is reported twice: {problems}"
    assert [f.name for f in tmp_path.iterdir()] == ["scene.yaml"]


@pytest.mark.parametrize("scene", SCENES, ids=lambda f: f.stem)
def test_random_damage_to_the_text_never_ends_in_anything_but_an_input_error(tmp_path, scene):
    draw = random.Random(2)
    text = scene.read_text()
    refused = 0
    for _ in range(400):
        damaged = text
        for _ in range(draw.randint(1, 3)):
            at, length = draw.randrange(len(damaged)), draw.choice([0, 0, 1, 3, 40])
            insert = draw.choice(
                ["", "\t", "[", "}", ": ", "\n", "*x", "&x ", "!!int ", "é", "\0", "- ", "'", "9" * 30]
            )
            damaged = damaged[:at] + insert + damaged[at + length :]
        refused += check_refusal(tmp_path / "scene.yaml", damaged) is not None
    assert refused > 300


@pytest.mark.parametrize("scene", SCENES, ids=lambda f: f.stem)
def test_a_scene_cut_short_is_refused_or_valid(tmp_path, scene):
    text = scene.read_text()
    outcomes = [check_refusal(tmp_path / "scene.yaml", text[:end]) for end in range(0, len(text) - 100, 40)]
    assert all(problems is not None for problems in outcomes[:-20])


class Creeping(Elastic):
    """A law of somebody else, with units of its own."""

    creep: float = Field(json_schema_extra={"unit": "Pa^3 s"})
    number: float = 0.0


def test_a_parameter_beyond_reason_is_refused_by_its_unit():
    example = Elastic.example().model_dump()
    largest = LARGEST["Pa"]
    assert Elastic(**example | {"bulk_modulus": largest}).bulk_modulus == largest
    with pytest.raises(ValueError, match="at most 1e\\+13 Pa in size, not 1.1e\\+13"):
        Elastic(**example | {"bulk_modulus": 1.1 * largest})
    with pytest.raises(ValueError, match="density\n.*at most 1e\\+06 kg/m\\^3 in size"):
        Elastic(**example | {"density": 2e6})
    assert Creeping(**example, creep=1e40, number=-1e20).creep == 1e40
    with pytest.raises(ValueError, match="at most 1e\\+60 Pa\\^3 s in size"):
        Creeping(**example, creep=1e61)
