"""Systematic damage to valid scenes: every mutation is refused in its place, on one screen."""

import copy
import random
from pathlib import Path

import pytest
import yaml

from periporo.io.input_errors import SCREEN_LINES, SCREEN_WIDTH, InputError, dotted
from periporo.io.schema import load_scene, scene_json_schema
from periporo.io.yaml_source import read_yaml
from periporo.materials.elastic import Elastic

SCENES = [Path(__file__).with_name(f"test_schema_{name}.yaml") for name in ("plane", "space")]
NOT_NUMBERS = [float("nan"), float("inf"), -float("inf"), -1e300, True, "abc", "1e-1 m", "½", [1], {"a": 1}]
NOT_WORDS = ["no such/word", "../../etc/passwd", "\u202e", "a" * 500, "", 1e3, False, [], ["x"], {"a": 1}]
NOT_BRANCHES = [True, "text", 7, 1e9]
NAMED = ("materials", "boundaries")  # keys below these are names, which may be anything


def required_keys():
    """Keys that are required wherever they occur in the schema."""
    models = [scene_json_schema(), Elastic.model_json_schema(), *scene_json_schema()["$defs"].values()]
    required = {key for model in models for key in model.get("required", [])}
    return required - {
        key for model in models for key in model["properties"] if key not in model.get("required", [])
    }


REQUIRED = required_keys()


def places(value, path=()):
    """(path, value) of everything below the top."""
    for part, entry in list(value.items()) if isinstance(value, dict) else list(enumerate(value)):
        yield (*path, part), entry
        if isinstance(entry, dict | list):
            yield from places(entry, (*path, part))


def edited(data, path, edit):
    """A copy of the scene in which `edit` was applied to the parent of the entry at `path`."""
    changed = copy.deepcopy(data)
    parent = changed
    for part in path[:-1]:
        parent = parent[part]
    edit(parent, path[-1])
    return changed


def renamed(parent, key, new):
    entries = [(new if k == key else k, v) for k, v in parent.items()]
    parent.clear()
    parent.update(entries)


def wrong_values(path, value):
    if value is None or path[-1] in ("title", "name", "file"):
        return [1e3, [], {"a": 1}, "\0", "x" * 5000] if value is not None else []
    if isinstance(value, bool):
        return [v for v in NOT_NUMBERS if v is not True]
    if isinstance(value, int | float):
        return NOT_NUMBERS if path[0] == "materials" else [*NOT_NUMBERS, 1e300, 10**40]
    return NOT_WORDS if isinstance(value, str) else NOT_BRANCHES


def mutations(data):
    """(what, path of the damage, damaged scene); each is invalid."""
    for path, value in places(data):
        is_key = isinstance(path[-1], str) and (len(path) < 2 or path[-2] not in NAMED)
        for wrong in wrong_values(path, value):
            if not (path[:2] == ("output", "fields") and wrong == [] or path[-1] == "where" and not wrong):
                yield f"= {wrong!r:.20}", path, edited(data, path, lambda p, k, w=wrong: p.__setitem__(k, w))
        if is_key and path[-1] in REQUIRED:
            yield "missing", path, edited(data, path, lambda p, k: p.pop(k))
        if is_key and len(path[-1]) > 3:
            typo = path[-1][:1] + path[-1][2:]
            yield "misspelt", (*path[:-1], typo), edited(data, path, lambda p, k, t=typo: renamed(p, k, t))
        if is_key:
            strange = "schlüssel"
            yield (
                "unknown",
                (*path[:-1], strange),
                edited(data, path, lambda p, k, s=strange: p.update({s: 1})),
            )


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
    cases = list(mutations(data))
    random.Random(1).shuffle(cases)
    assert len(cases) > 400
    for what, path, damaged in cases[:400]:
        text = yaml.dump(damaged, Dumper=yaml.CSafeDumper, sort_keys=False, allow_unicode=True)
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
