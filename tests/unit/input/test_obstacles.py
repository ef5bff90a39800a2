"""Obstacles that cannot be used are refused where they stand, and say how to go on."""

import pytest

from periporo.errors import InputError
from periporo.io.input.load import parse_scene

SOIL = {"model": "elastic", "density": 1800.0, "bulk_modulus": 2e6, "shear_modulus": 1e6}
DRIFTING = {"x": {"times": [0, 1, 2], "values": [0, 1, 0]}}
WALL = {"type": "box", "lower": [2, 0], "upper": [3, 1], "friction": 0.3}
BALL = {"type": "sphere", "center": [0, 0, 3], "radius": 0.5, "friction": 0.3}


def scene(dimension, contact, **keys):
    box = {"type": "box", "lower": [0] * dimension, "upper": [1] * dimension}
    return parse_scene({
        "dimension": dimension, "spacing": 0.1, "gravity": [0] * (dimension - 1) + [-9.81], "materials": {"soil": SOIL},
        "bodies": [{"name": "block", "material": "soil", "shape": box}], "contacts": [contact],
        "boundaries": {"base": {"where": {"upper": [None] * (dimension - 1) + [0.1]}, "fix": ["x"]}},
        "stages": [{"name": "go", "type": "dynamics", "duration": 0.1}],
    } | keys, ".")  # fmt: skip


@pytest.mark.parametrize("dimension, contact, place, words", [
    (2, WALL | {"free": {}}, "contacts[0].free", "needs a mass: give either mass or density"),
    (2, WALL | {"free": {"mass": 1, "density": 1}}, "contacts[0].free", "give either mass or density"),
    (2, WALL | {"free": {"mass": 1}, "velocity": [1, 0]}, "contacts[0]", "moves by itself: leave out velocity"),
    (2, WALL | {"free": {"mass": 1, "hold": ["z"]}}, "contacts[0].free.hold", "no z direction"),
    (2, {"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0, "free": {"mass": 1}}, "contacts[0].free",
     "unknown key"),
    (2, WALL | {"velocity": [1, 0], "displacement": {"x": 1}}, "contacts[0]", "found velocity and displacement"),
    (2, WALL | {"velocity": [1, 0, 0]}, "contacts[0].velocity", "must have 2 components"),
    (2, WALL | {"velocity": {"z": 1}}, "contacts[0].velocity.z", "no z direction"),
    (2, WALL | {"acceleration": DRIFTING}, "contacts[0].acceleration.x", "has a drift: its end is 100%"),
    (2, WALL | {"rotation": {"rate": 1, "axis": [0, 1]}}, "contacts[0].rotation.axis", "leave out the axis"),
    (2, WALL | {"rotation": {}}, "contacts[0].rotation", "give either angle or rate"),
    (3, BALL | {"rotation": {"rate": 1}}, "contacts[0].rotation.axis", "needs the direction of its axis"),
    (2, WALL | {"name": "base"}, "contacts[0].name", "stands for another obstacle, or a boundary"),
    (2, BALL | {"center": [0, 3]}, "contacts[0].type", "a sphere exists only in 3 dimensions"),
    (2, {"type": "wedge", "tip": [0, 2], "width": 1, "angle": 60, "length": 0.5, "friction": 0}, "contacts[0]",
     "its tip alone is 0.866 m long"),
])  # fmt: skip
def test_what_is_refused(dimension, contact, place, words):
    with pytest.raises(InputError) as error:
        scene(dimension, contact)
    text = " ".join(str(error.value).split())
    assert f"{place}: " in text and words in text, text


def test_what_would_never_move_is_refused():
    relax = [{"name": "rest", "type": "relax"}]
    with pytest.raises(InputError, match="would never move"):
        scene(2, WALL | {"free": {"mass": 1}}, stages=relax)
