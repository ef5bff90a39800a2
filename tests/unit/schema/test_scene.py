"""Valid scenes: what is accepted, defaults, round trip through JSON, JSON Schema."""

import importlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from pydantic import BaseModel, ConfigDict, Field

from periporo.errors import InputError
from periporo.io.input.load import load_scene, parse_scene
from periporo.io.schema.scene import SceneInput, scene_json_schema

PLANE = Path(__file__).with_name("plane.yaml")
SPACE = Path(__file__).with_name("space.yaml")


def test_every_key_of_a_plane_scene():
    scene = load_scene(PLANE)
    assert scene.spacing == 0.1 and scene.horizon == 2.5 and scene.seed == 7
    assert scene.bodies[0].layers[0].material == "rock"
    assert scene.boundaries["push"].velocity.x.values == (0.1,)
    assert scene.boundaries["pull"].displacement.y.times == (0.0, 1.0)
    assert scene.contacts[0].stages == ("collapse",) and scene.contacts[1].stages is None
    assert scene.pore_water.frozen is True
    assert scene.stages[1].damping.viscous == 0.1
    assert scene.output.file == "results/run.h5"


def test_space_and_defaults():
    scene = load_scene(SPACE)
    assert (scene.horizon, scene.influence) == (2.2, "cubic")
    assert scene.correspondence.scheme == "point_state"
    assert scene.correspondence.options() == {"sharpened": True, "regular": True}
    assert scene.gravity is None and scene.seed == 0 and scene.checkpoint is None
    assert scene.bodies[0].jitter == 0.0 and scene.contacts[0].stiffness is None
    assert (scene.time_step.safety, scene.time_step.update) == (0.8, 20)
    assert scene.monitor.energy_tolerance == 0.01 and scene.output.history_interval == 10
    assert scene.pore_water.water_density == 1000.0
    np.testing.assert_array_equal(scene.vector(scene.gravity), np.zeros(3))
    np.testing.assert_array_equal(scene.vector((1, 2, 3)), [1.0, 2.0, 3.0])


@pytest.mark.parametrize("file", [PLANE, SPACE])
def test_json_round_trip_is_the_same_scene(file):
    scene = load_scene(file)
    assert parse_scene(json.loads(json.dumps(scene.model_dump()))) == scene


def test_a_scene_is_immutable():
    scene = load_scene(SPACE)
    with pytest.raises(ValueError, match="frozen"):
        scene.spacing = 1.0


def test_materials_are_made_from_their_parameters():
    scene = load_scene(PLANE)
    assert scene.materials["rock"].parameters == {
        "density": 2600.0,
        "bulk_modulus": 25e9,
        "shear_modulus": 15e9,
    }
    rock = scene.materials["rock"].create()
    assert type(rock).__name__ == "Elastic" and rock.bulk_modulus == 25e9


def minimal():
    return {
        "dimension": 2,
        "spacing": 0.1,
        "materials": {
            "soil": {"model": "elastic", "density": 1e3, "bulk_modulus": 1e6, "shear_modulus": 1e6}
        },
        "bodies": [
            {"name": "b", "material": "soil", "shape": {"type": "box", "lower": [0, 0], "upper": [1, 1]}}
        ],
        "stages": [{"name": "s", "type": "dynamics", "duration": 1.0}],
    }


def test_dictionaries_with_arrays_are_scenes():
    data = minimal()
    data["bodies"][0]["shape"]["upper"] = np.array([1.0, 2.0])
    data["spacing"] = np.float64(0.1)
    data["seed"] = np.int64(3)
    data["gravity"] = (0, -9.81)
    scene = parse_scene(data)
    assert scene.bodies[0].shape.upper == (1.0, 2.0) and scene.seed == 3 and scene.gravity == (0.0, -9.81)


def test_dictionaries_that_are_no_scenes_are_refused_in_the_same_way():
    circular = minimal()
    circular["title"] = circular
    for data, says in [
        (circular, "nested"),
        (minimal() | {1: 2}, "1"),
        (minimal() | {"spacing": 10**400}, "spacing"),
        (None, "mapping"),
        ([1], "mapping"),
    ]:
        with pytest.raises(InputError, match=says):
            parse_scene(data)


def test_unicode_names_are_names():
    data = minimal()
    data["bodies"][0]["name"] = "Säule 1"
    assert parse_scene(data).bodies[0].name == "Säule 1"


def test_points_are_found_beside_the_scene_and_output_stays_in_the_working_folder(tmp_path):
    (tmp_path / "points.csv").write_text("x,y\n0,0\n0.1,0\n")
    data = minimal()
    data["bodies"][0]["shape"] = {"type": "points", "file": "points.csv"}
    scene = parse_scene(data, folder=tmp_path)
    assert scene.bodies[0].shape.file == str((tmp_path / "points.csv").resolve())


class PlainLaw:
    density = 1.0
    state_fields = ()
    owns_pore_pressure = True

    def __init__(self, modulus, exponent=1):
        if modulus < 0:
            raise ValueError("modulus must be positive")


def test_a_plain_class_of_a_plugin_checks_its_own_parameters(monkeypatch):
    monkeypatch.setattr("periporo.materials.registry.load", lambda name: PlainLaw)
    data = minimal()
    data["materials"]["soil"] = {"model": "plain", "modulus": 2.0, "exponent": 3}
    assert isinstance(parse_scene(data).materials["soil"].create(), PlainLaw)
    for parameters, says in [
        ({"modulus": -1}, "must be positive"),
        ({"modulu": 1}, "modulu"),
        ({}, "modulus"),
    ]:
        data["materials"]["soil"] = {"model": "plain", **parameters}
        with pytest.raises(InputError, match=says):
            parse_scene(data)
    data["materials"]["soil"] = {"model": "plain", "modulus": 2.0}
    data["pore_water"] = {"suction": 0, "retention": {"set": "fitted"}}
    with pytest.raises(InputError, match="its own pore pressure"):
        parse_scene(data)


class Curve:
    """A type that pydantic can neither validate nor describe."""


class LawWithACurve(BaseModel):
    model_config = ConfigDict(arbitrary_types_allowed=True, extra="forbid")
    modulus: float = Field(gt=0)
    curve: Curve = Curve()


def test_a_pydantic_law_without_json_schema_is_validated_as_well(monkeypatch):
    monkeypatch.setattr("periporo.materials.registry.load", lambda name: LawWithACurve)
    data = minimal()
    data["materials"]["soil"] = {"model": "curved", "modulus": -1, "curv": 2}
    with pytest.raises(InputError) as caught:
        parse_scene(data)
    unknown, bound = caught.value.problems
    assert "did you mean 'curve'? Allowed: modulus, curve" in unknown.message
    assert "greater than 0" in bound.message


@pytest.mark.parametrize(
    "module, hint", [("gone", "$"), ("periporo.core.gone", r"; what a law needs of periporo is in periporo.materials$")]
)
def test_a_law_that_cannot_be_imported_is_a_clear_error(monkeypatch, module, hint):
    monkeypatch.setattr("periporo.materials.registry.load", lambda name: importlib.import_module(module))
    with pytest.raises(InputError) as caught:
        parse_scene(minimal())
    assert re.search(f"cannot be imported: No module named '{module}'{hint}", caught.value.problems[0].message)


def test_json_schema_describes_every_key():
    schema = scene_json_schema()
    json.dumps(schema)
    models = [schema, *schema["$defs"].values()]
    keys = [entry for model in models for entry in model.get("properties", {}).values()]
    assert len(keys) > 100 and all(entry.get("description") for entry in keys)
    assert all(model["additionalProperties"] is ("model" in model["properties"]) for model in models)
    spacing = schema["properties"]["spacing"]
    assert spacing["unit"] == "m" and spacing["minimum"] > 0
    assert set(schema["required"]) == {"dimension", "spacing", "materials", "bodies", "stages"}
    assert schema == SceneInput.model_json_schema()
