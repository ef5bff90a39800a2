"""Words of the command line about the input: examples, schema, materials; refusals while a scene is being built."""

import json
import re
import subprocess
import sys
from importlib import resources
from pathlib import Path

import jsonschema
import pytest
import yaml

from periporo.core.numerics import jit
from periporo.io.input.examples import example_texts
from periporo.io.input.load import load_scene
from periporo.io.schema.reference import editor_schema
from periporo.materials import registry

REFERENCE = Path(__file__).parents[3] / "docs" / "reference" / "scene"
SOIL = {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}


def test_new_lists_every_example_with_its_title(call):
    status, out, _ = call("new")
    shipped = {f.name for f in resources.files("periporo.configs").iterdir() if f.name.endswith(".yaml")}
    assert status == 0 and len(shipped) >= 5
    for file in shipped:
        title = yaml.safe_load(example_texts()[file.removesuffix(".yaml")])["title"]
        assert any(line.split()[0] == file.removesuffix(".yaml") and title in line for line in out.splitlines())


def test_new_writes_valid_scenes_and_replaces_nothing(call, tmp_path):
    for name in example_texts():
        assert call("new", name)[0] == 0
        assert load_scene(tmp_path / f"{name}.yaml").title
    (tmp_path / "mine.yaml").write_text("precious")
    for words in (("slope",), ("slope", "mine.yaml")):
        status, out, error = call("new", *words)
        assert status == 2 and out == "" and f"{words[-1].removesuffix('.yaml')}.yaml exists" in error
    assert (tmp_path / "mine.yaml").read_text() == "precious"
    assert call("new", "slope", "other.yaml")[0] == 0 and (tmp_path / "other.yaml").exists()


def test_names_that_do_not_exist(call):
    status, _, error = call("new", "slop")
    assert status == 2 and "did you mean 'slope'?" in error
    status, _, error = call("materials", "elastc")
    assert status == 2 and "did you mean 'elastic'?" in error


def test_materials_lists_parameters_with_units_defaults_and_bounds(call):
    status, out, _ = call("materials")
    assert status == 0
    assert all(f"{name} (periporo " in out for name in ("arena", "cam_clay", "drucker_prager", "elastic"))
    rows = {line.split()[0]: line for line in call("materials", "drucker_prager")[1].splitlines()[1:]}
    assert rows["friction_angle"].split()[1:3] == ["deg", "required"]
    assert "number >= 0, < 90" in rows["friction_angle"] and "angle of friction" in rows["friction_angle"]
    assert rows["dilation_angle"].split()[2] == "0"


class PlainLaw:
    """A law without pydantic. It says no more."""

    def __init__(self, modulus, exponent=1.5, *, table=(1, 2)):
        pass


def test_laws_of_plugins_are_listed_even_if_they_are_broken(call, monkeypatch):
    def load(name):
        if name == "arena":
            raise RuntimeError("no licence")
        return PlainLaw

    monkeypatch.setattr(registry, "load", load)
    status, out, _ = call("materials", "arena", "elastic")
    assert status == 0 and "cannot be imported: RuntimeError: no licence" in out
    lines = out.splitlines()
    assert lines[2].endswith("A law without pydantic")
    assert [line.split() for line in lines[4:]] == [["modulus", "required"], ["exponent", "1.5"], ["table"]]


def test_schema_accepts_every_example_and_refuses_what_the_program_refuses(call):
    schema = json.loads(call("schema")[1])
    jsonschema.Draft202012Validator.check_schema(schema)
    valid = jsonschema.Draft202012Validator(schema).is_valid
    for text in example_texts().values():
        scene = yaml.load(text, Loader=_numbers())
        assert valid(scene)
        law = next(iter(scene["materials"].values()))
        for place, key, value in (
            (scene, "horizn", 2.0), (scene, "spacing", -1.0), (scene, "contacts", [{"type": "plain"}]),
            (law, "densty", 1.0), (law, "model", "elastc"),
        ):  # fmt: skip
            before = dict(place)
            place[key] = value
            assert not valid(scene)
            place.clear()
            place.update(before)
        assert valid(scene)


def _numbers():
    """PyYAML's loader with 25e6 as a number, as in YAML 1.2, which editors read."""

    class Loader(yaml.SafeLoader):
        pass

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", re.compile(r"[-+]?[0-9.]+e[-+]?[0-9]+$"),
                                 list("-+0123456789."))  # fmt: skip
    return Loader


def test_schema_tells_editors_what_a_key_means():
    schema = editor_schema()
    assert schema["properties"]["spacing"]["description"] == "distance of the points [m]"
    assert schema["properties"]["spacing"]["minimum"] == 1e-6
    law = schema["$defs"]["law drucker_prager"]
    assert law["properties"]["cohesion"]["description"].endswith("[Pa]") and "model" in law["required"]
    for law, key in (("elastic", "bulk_modulus"), ("mohr_coulomb", "cohesion"), ("umat", "shear_modulus")):
        assert {"$ref": "periporo:field"} in schema["$defs"][f"law {law}"]["properties"][key]["anyOf"]


def test_a_law_with_definitions_of_its_own_keeps_its_references(monkeypatch):
    inner = {"$defs": {"Body": {"type": "integer"}}, "type": "object", "properties": {"n": {"$ref": "#/$defs/Body"}}}
    monkeypatch.setattr("periporo.io.schema.reference.law_schema", lambda law: json.loads(json.dumps(inner)))
    schema = editor_schema()
    scene = yaml.load(example_texts()["slope"], Loader=_numbers())
    scene["materials"] = {"silt": {"model": "elastic", "n": 3}, "rock": {"model": "arena", "n": 4}}
    valid = jsonschema.Draft202012Validator(schema).is_valid
    assert valid(scene)
    scene["materials"]["silt"]["n"] = "three"
    assert not valid(scene)


def test_the_input_reference_is_the_one_in_the_docs(call, tmp_path):
    assert call("schema", "--markdown", str(tmp_path / "pages")) == (0, "", "")
    made = {page.name: page.read_text() for page in (tmp_path / "pages").iterdir()}
    assert made == {page.name: page.read_text() for page in REFERENCE.iterdir()}
    for page, text in made.items():
        for target, anchor in re.findall(r"\]\((\w+\.md)?#([\w-]+)\)", text):
            assert anchor in anchors(made[target or page]), f"{page} has a link that leads nowhere: {target}#{anchor}"


def anchors(text):
    """What headings of a page are called in links."""
    return {line.lstrip("# ").lower().replace(" ", "-") for line in text.splitlines() if line.startswith("#")}


def test_the_input_reference_on_one_page(call):
    status, out, _ = call("schema", "--markdown")
    assert status == 0
    for words in ("## Plane contact", "| `K0` | horizontal over vertical stress | 1 | number >= 0, <= 10 | `0.5` |",
                  "## `model: arena`"):  # fmt: skip
        assert words in out
    links = {part.split(")")[0] for part in out.split("](#")[1:]}
    assert len(links) > 20 and links <= anchors(out) and ".md#" not in out


def test_a_reader_that_has_seen_enough_is_no_error(tmp_path):
    program = [sys.executable, "-m", "periporo.core.cli", "schema"]
    with subprocess.Popen(program, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.read(10)
        process.stdout.close()
        assert process.stderr.read() == "" and process.wait(timeout=60) == 0


WRONG = {
    "penetration": ({"contacts": [{"type": "plane", "point": [0, 0.004], "normal": [0, 1], "friction": 0.5}]},
                    ("contacts[0]", "the body 'block' reaches 0.004 m into this plane", "relax stage")),
    "behind": ({"contacts": [{"type": "box", "lower": [-0.01, 0.02], "upper": [0.01, 0.03], "friction": 0.5}]},
               ("contacts[0]", "into this box", "leave the contact out of 'fall'")),
    "empty region": ({"boundaries": {"wall": {"where": {"lower": [9.0, None]}, "fix": ["x"]}},
                      "stages": [{"name": "a", "type": "dynamics", "duration": 1e-3, "boundaries": ["wall"]}]},
                     ("boundaries.wall.where", "no point of the scene")),
    "unknown field": ({"output": {"fields": ["stres"]}}, ("output.fields", "stress")),
}  # fmt: skip


@pytest.mark.parametrize("warm", [True, False])
@pytest.mark.parametrize("case", WRONG)
def test_refusals_while_building_name_file_and_line_and_nothing_is_said_before(
    call, scene_of, tmp_path, monkeypatch, case, warm
):
    monkeypatch.setattr(jit, "cache_is_warm", lambda: warm)
    changes, words = WRONG[case]
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene_of() | changes))
    status, out, error = call("scene.yaml")
    assert status == 2 and out == ""
    assert error.startswith("periporo: scene.yaml: 1 problem\n  line ")
    said = " ".join(error.split())
    assert all(word in said for word in words), said
    assert [p.name for p in tmp_path.iterdir()] == ["scene.yaml"]
    path, line = words[0].split("[")[0].split(".")[-1], int(said.split("line ")[1].split(",")[0])
    text = (tmp_path / "scene.yaml").read_text().splitlines()[line - 1]
    assert path in text or text.startswith("- ")  # an entry of a list is named by its own line


@pytest.mark.parametrize(
    ("height", "stage", "jitter", "accepted"),
    [(0.0, "dynamics", 0.0, True), (-0.00009, "dynamics", 0.0, True), (-0.00011, "dynamics", 0.0, False),
     (0.0, "dynamics", 0.25, True), (-0.002, "dynamics", 0.25, False),
     (-0.0059, "relax", 0.0, True), (-0.0061, "relax", 0.0, False)],
)  # fmt: skip
def test_how_far_a_body_may_reach_into_an_obstacle(call, scene_of, tmp_path, height, stage, jitter, accepted):
    """Spacing 0.01 m: 0.01 spacings and the jitter when motion begins, 0.6 when a relaxation does."""
    scene = scene_of()
    box = scene["bodies"][0]["shape"]
    box["lower"][1], box["upper"][1] = box["lower"][1] + height, box["upper"][1] + height
    scene["bodies"][0]["jitter"] = jitter
    scene["stages"] = [{"name": "a", "type": stage} | ({"duration": 1e-5} if stage == "dynamics" else {})]
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene))
    status, _, error = call("check", "scene.yaml")
    assert status == (0 if accepted else 2), error
