"""Scenes that are refused: where the message points, what it says, and that it fits one screen."""

import pickle

import pytest

from periporo.errors import SCREEN_LINES, SCREEN_WIDTH, InputError, Problem, dotted, nearest
from periporo.io.input.load import load_scene

BASE = """\
dimension: 2
spacing: 0.1
materials:
  soil: {model: elastic, density: 1760, bulk_modulus: 25e6, shear_modulus: 15e6}
bodies:
  - name: column
    material: soil
    shape: {type: box, lower: [0, 0], upper: [1, 1]}
gravity: [0, -9.81]
boundaries:
  base: {where: {upper: [null, 0.1]}, fix: [x, y]}
contacts:
  - {type: plane, point: [0, 0], normal: [0, 1], friction: 0.5}
stages:
  - {name: settle, type: relax, boundaries: [base]}
"""


def refusal(tmp_path, text):
    file = tmp_path / "scene.yaml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_scene(file)
    error = caught.value
    lines = str(error).splitlines()
    assert len(lines) <= SCREEN_LINES and max(map(len, lines)) <= SCREEN_WIDTH
    assert "Traceback" not in str(error) and "pydantic" not in str(error)
    return error


CASES = [
    ("{model: elastic", "{modl: elastic", 4, "materials.soil.modl", "did you mean 'model'"),
    # old text, new text, line, path, words of the message
    ("spacing: 0.1", "spacng: 0.1", 2, "spacng", "did you mean 'spacing'"),
    ("spacing: 0.1", "Spacing: 0.1", 2, "Spacing", "did you mean 'spacing'"),
    ("spacing: 0.1", "title: t", 1, "spacing", "missing (distance of the points, m)"),
    ("spacing: 0.1", "spacing: yes", 2, "spacing", "must be a number, not a yes/no value (True)"),
    ("spacing: 0.1", "spacing: ", 2, "spacing", "must be a number, not nothing"),
    ("spacing: 0.1", "spacing: '1e-1'", 2, "spacing", "write it without quotes"),
    ("spacing: 0.1", "spacing: .nan", 2, "spacing", "must be a finite number"),
    ("spacing: 0.1", "spacing: -0.1", 2, "spacing", "must be at least 1e-06 and at most 10000, not -0.1"),
    ("spacing: 0.1", "spacing: 1e300", 2, "spacing", "at most 10000"),
    ("spacing: 0.1", "spacing: 2", 8, "bodies[0].shape", "less than one spacing"),
    ("spacing: 0.1", "spacing: 1e-6", 2, "spacing", "too many"),
    ("spacing: 0.1", "spacing: 0.1\nspacing: 0.2", 3, "spacing", "twice, first in line 2"),
    ("spacing: 0.1", "spacing: 0.1\ninfluence: Conic", 3, "influence", "did you mean 'conical'"),
    ("dimension: 2", "dimension: 4", 1, "dimension", "allowed: 2, 3"),
    ("dimension: 2", "dimension: 3", 8, "bodies[0].shape.lower", "must have 3 components"),
    ("{model: elastic,", "{model: elastc,", 4, "materials.soil.model", "did you mean 'elastic'"),
    ("{model: elastic,", "{", 4, "materials.soil.model", "missing (name of an installed law"),
    ("bulk_modulus", "bulk_modulu", 4, "materials.soil.bulk_modulu", "did you mean 'bulk_modulus'"),
    ("25e6", "-25e6", 4, "materials.soil.bulk_modulus", "must be greater than 0"),
    ("density: 1760, ", "", 4, "materials.soil.density", "missing (dry bulk density, kg/m^3)"),
    ("  soil:", "  so/il:", 4, "materials.so/il", "not a valid name"),
    ("material: soil", "material: sol", 7, "bodies[0].material", "did you mean 'soil'"),
    ("type: box", "typ: box", 8, "bodies[0].shape.typ", "did you mean 'type'?"),
    ("type: box", "type: bx", 8, "bodies[0].shape.type", "did you mean 'box'"),
    ("type: box, lower", "type: box, lowr", 8, "bodies[0].shape.lowr", "did you mean 'lower'"),
    ("type: box", "type: box, box: 1", 8, "bodies[0].shape.box", "unknown key"),
    ("upper: [1, 1]", "upper: [1, -1]", 8, "bodies[0].shape.upper", "along y it must exceed 'lower' (0)"),
    ("upper: [1, 1]", "upper: 1", 8, "bodies[0].shape.upper", "must be a list, not 1"),
    ("upper: [1, 1]", "upper: [1]", 8, "bodies[0].shape.upper", "at least 2 entries"),
    ("upper: [1, 1]", "upper: [1, no]", 8, "bodies[0].shape.upper[1]", "must be a number"),
    ("{type: box, lower: [0, 0], upper: [1, 1]}", "box", 8, "bodies[0].shape", "must be a mapping"),
    (
        "{type: box, lower: [0, 0], upper: [1, 1]}",
        "{type: sphere, center: [0, 0], radius: 1}",
        8,
        "bodies[0].shape.type",
        "exists only in 3 dimensions",
    ),
    (
        "{type: box, lower: [0, 0], upper: [1, 1]}",
        "{type: points, file: gone.csv}",
        8,
        "bodies[0].shape.file",
        "there is no regular file",
    ),
    (
        "{type: box, lower: [0, 0], upper: [1, 1]}",
        "{type: polygon, vertices: [[0, 0], [1, 0], [0, 1]], extrude: [0, 1]}",
        8,
        "bodies[0].shape",
        "must not have 'extrude' in 2 dimensions",
    ),
    (
        "{type: box, lower: [0, 0], upper: [1, 1]}",
        "{type: polygon, vertices: [[0, 0], [1, 1], [2, 2]]}",
        8,
        "bodies[0].shape",
        "lie on one line",
    ),
    (
        "{type: box, lower: [0, 0], upper: [1, 1]}",
        "{type: polygon, vertices: [[0, 0], [1, 0.5], [1, 0.505]]}",
        8,
        "bodies[0].shape",
        "contains no point",
    ),
    ("gravity: [0, -9.81]", "gravity: [0, 0, -9.81]", 9, "gravity", "must have 2 components"),
    ("gravity: [0, -9.81]", "initial_stress: {type: geostatic}", 9, "initial_stress.type", "needs gravity"),
    (
        "gravity: [0, -9.81]",
        "initial_stress: {type: uniform, components: {xz: 1}}",
        9,
        "initial_stress.components.xz",
        "must be zero in 2 dimensions",
    ),
    ("gravity: [0, -9.81]", "output: {file: ../x.h5}", 9, "output.file", "a name without '..'"),
    ("gravity: [0, -9.81]", "output: {file: /tmp/x.h5}", 9, "output.file", "relative to the working folder"),
    ("gravity: [0, -9.81]", "output: {file: ~/x.h5}", 9, "output.file", "relative to the working folder"),
    ("gravity: [0, -9.81]", 'output: {file: "a\\0.h5"}', 9, "output.file", "control characters"),
    ("gravity: [0, -9.81]", "output: {file: x.yaml}", 9, "output.file", "must end in one of .vtkhdf, .h5"),
    ("gravity: [0, -9.81]", "seed: 1.5", 9, "seed", "must be an integer, not 1.5"),
    ("gravity: [0, -9.81]", "seed: -1", 9, "seed", "must be at least 0"),
    (
        "gravity: [0, -9.81]",
        "monitor: {points: [[0, 0, 0]]}",
        9,
        "monitor.points[0]",
        "must have 2 components",
    ),
    (
        "gravity: [0, -9.81]",
        "pore_water: {suction: 1, retention: {}}",
        9,
        "pore_water.retention",
        "exactly one",
    ),
    (
        "gravity: [0, -9.81]",
        "pore_water: {suction: 1, retention: {alpha1: 1}}",
        9,
        "pore_water.retention",
        "all of alpha1, alpha2, alpha3",
    ),
    (
        "    material: soil",
        "    material: soil\n    layers: [{above: 1, material: soil}, {above: 1, material: soil}]",
        6,
        "bodies[0]",
        "must ascend",
    ),
    (
        "    material: soil",
        "    material: soil\n    layers: [{above: 1, material: clay}]",
        8,
        "bodies[0].layers[0].material",
        "there is no material 'clay'",
    ),
    (
        "gravity: [0, -9.81]\n",
        "  - {name: column, material: soil, shape: {type: disc, center: [9, 9], radius: 1}}\n",
        9,
        "bodies[1].name",
        "stands in bodies twice",
    ),
    (
        "gravity: [0, -9.81]\n",
        "  - {name: b, material: soil, shape: {type: disc, center: [1, 1], radius: 1}}\n",
        9,
        "bodies[1].shape",
        "overlaps the body 'column'",
    ),
    ("fix: [x, y]", "fix: [x, z]", 11, "boundaries.base.fix", "no z direction"),
    ("fix: [x, y]", "fix: [x, w]", 11, "boundaries.base.fix[1]", "allowed: x, y, z"),
    ("fix: [x, y]", "fix: [x, x]", 11, "boundaries.base", "twice"),
    ("fix: [x, y]", "fix: [x], velocity: {y: 1}", 11, "boundaries.base", "found fix and velocity"),
    (", fix: [x, y]", "", 11, "boundaries.base", "found none"),
    ("fix: [x, y]", "velocity: {}", 11, "boundaries.base.velocity", "at least one of x, y, z"),
    ("fix: [x, y]", "velocity: {z: 1}", 11, "boundaries.base.velocity.z", "no z direction"),
    ("fix: [x, y]", "velocity: {x: fast}", 11, "boundaries.base.velocity.x", "a number, {times, values} or {file}"),
    ("fix: [x, y]", "velocity: {x: yes}", 11, "boundaries.base.velocity.x", "yes/no"),
    (
        "fix: [x, y]",
        "velocity: {x: {times: [0, 1], values: [1]}}",
        11,
        "boundaries.base.velocity.x",
        "2 times but 1 values",
    ),
    (
        "fix: [x, y]",
        "velocity: {x: {times: [1, 1], values: [1, 2]}}",
        11,
        "boundaries.base.velocity.x",
        "times must increase",
    ),
    ("fix: [x, y]", "displacement: {x: 0.1}", 11, "boundaries.base.displacement.x", "jump by 0.1 m"),
    ("fix: [x, y]", "traction: {stress: [1, 0], side: z+}", 11, "boundaries.base.traction.side", "no z"),
    ("{upper: [null, 0.1]}", "{}", 11, "boundaries.base.where", "at least one of lower, upper, body"),
    ("{upper: [null, 0.1]}", "{body: colum}", 11, "boundaries.base.where.body", "did you mean 'column'"),
    ("normal: [0, 1]", "normal: [0, 0]", 13, "contacts[0]", "must not be zero"),
    ("friction: 0.5", "friction: -0.5", 13, "contacts[0].friction", "at least 0"),
    ("friction: 0.5", "friction: 0.5, stages: [settl]", 13, "contacts[0].stages[0]", "did you mean 'settle'"),
    ("friction: 0.5", "friction: 0.5, damping: 2", 13, "contacts[0].damping", "at most 1"),
    (
        "{type: plane, point: [0, 0], normal: [0, 1], friction: 0.5}",
        "{type: bodies, first: column, second: column, friction: 0}",
        13,
        "contacts[0].second",
        "another body",
    ),
    (
        "{type: plane, point: [0, 0], normal: [0, 1], friction: 0.5}",
        "{type: polyline, vertices: [[0, 0], [0, 0]], friction: 0}",
        13,
        "contacts[0]",
        "vertices 0 and 1",
    ),
    ("boundaries: [base]", "boundaries: [bas]", 15, "stages[0].boundaries[0]", "did you mean 'base'"),
    ("type: relax", "type: dynamics", 15, "stages[0].duration", "missing (duration, s)"),
    ("type: relax", "type: relax, tolerance: 1", 15, "stages[0].tolerance", "at most 0.1"),
    ("type: relax", "type: relax, duration: 1", 15, "stages[0].duration", "unknown key"),
]


@pytest.mark.parametrize(("old", "new", "line", "path", "says"), CASES)
def test_one_mistake_is_one_problem_in_its_place(tmp_path, old, new, line, path, says):
    text = BASE.replace(old, new, 1)
    assert text != BASE
    error = refusal(tmp_path, text)
    first = error.problems[0]
    assert (first.line, dotted(first.path)) == (line, path)
    assert says in first.message
    if "dimension" not in old:
        assert len(error.problems) == 1


def test_the_base_scene_itself_is_valid(tmp_path):
    (tmp_path / "scene.yaml").write_text(BASE)
    assert load_scene(tmp_path / "scene.yaml").dimension == 2


def test_several_problems_are_reported_together_in_order_of_lines(tmp_path):
    text = (
        BASE.replace("spacing", "spacng")
        .replace("25e6", "-1")
        .replace("fix", "fixed")
        .replace("name: s", "nam: s")
    )
    error = refusal(tmp_path, text)
    assert [p.line for p in error.problems] == [2, 4, 11, 15]
    assert str(error).startswith(f"{tmp_path}/scene.yaml"[:60])


def test_a_flood_of_problems_is_cut_to_one_screen(tmp_path):
    error = refusal(tmp_path, BASE + "".join(f"key{k}: 1\n" for k in range(200)))
    assert len(error.problems) == 200
    shown = str(error).count("unknown key")
    assert 5 <= shown <= 15 and str(error).endswith(f"and {200 - shown} more")


@pytest.mark.parametrize(("value", "path", "says"), [
    (".nan", "", "must be a finite number"), ("many", "", "must be a number"), ("[4]", "", "must be a number"),
    ("{STREN: x}", ".STREN", "must be a number"), ("{STREN: .nan}", ".STREN", "must be a finite number"),
])  # fmt: skip
def test_a_number_or_a_mapping_of_numbers_is_one_problem(tmp_path, value, path, says):
    law = f"soil: {{model: arena, weibull_modulus: {value}}}"
    (problem,) = refusal(tmp_path, BASE.replace(BASE.splitlines()[3].strip(), law)).problems
    assert dotted(problem.path) == "materials.soil.weibull_modulus" + path and problem.message.startswith(says)


def test_entries_of_a_wrong_list_are_reported_once(tmp_path):
    error = refusal(tmp_path, BASE.replace("upper: [1, 1]", "upper: [a, b]"))
    assert [dotted(p.path) for p in error.problems] == [
        "bodies[0].shape.upper[0]",
        "bodies[0].shape.upper[1]",
    ]


def test_hostile_text_cannot_reach_the_terminal(tmp_path):
    error = refusal(tmp_path, BASE.replace("spacing", '"\\e[2Jspacing\\u202e"'))
    assert "\x1b" not in str(error) and "\u202e" not in str(error)


def test_an_input_error_survives_being_sent_to_other_ranks():
    error = InputError("scene.yaml", [Problem(("b", 1), "later", 7), Problem(("a",), "earlier", 3)])
    copy = pickle.loads(pickle.dumps(error))
    assert str(copy) == str(error) and copy.problems == error.problems
    assert str(error).splitlines() == [
        "scene.yaml: 2 problems",
        "  line 3, a: earlier",
        "  line 7, b[1]: later",
    ]


def test_nearest_ignores_case_and_gives_up_on_strangers():
    assert nearest("SPACNG", ["spacing", "stages"]) == "spacing"
    assert nearest("zzz", ["spacing", "stages"]) is None
