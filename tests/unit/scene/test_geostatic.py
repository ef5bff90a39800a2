"""Geostatic stress at the start: layers, free surfaces, bodies of every shape, wet soil."""

import numpy as np
import pytest

from periporo.core.scene.geostatic import GeostaticStress
from periporo.io.geometry.lattice import build_lattices
from periporo.io.input.load import parse_scene

SOIL = {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
G, K0 = 9.81, 0.6


def stress_of(bodies, positions, *, density=(1000.0, 2000.0, 3000.0), gravity=None, surface=None, folder="."):
    positions = np.array(positions, float)
    d = positions.shape[1]
    gravity = [0.0] * (d - 1) + [-G] if gravity is None else gravity
    scene = parse_scene({
        "dimension": d, "spacing": 0.1, "gravity": gravity, "materials": dict.fromkeys(["a", "b", "c"], SOIL),
        "bodies": [{"name": str(k), "material": "a"} | body for k, body in enumerate(bodies)],
        "stages": [{"name": "rest", "type": "relax"}],
    }, folder)  # fmt: skip
    lattices = build_lattices(scene)
    return GeostaticStress(lattices, np.array(density), np.array(gravity, float), K0, surface)(positions)


def box(lower, upper, **keys):
    return {"shape": {"type": "box", "lower": lower, "upper": upper}} | keys


def test_one_layer_and_a_buried_one():
    found = stress_of([box([0, 0], [1, 2])], [[0.5, 0.5], [0.1, 2.0], [0.9, 0.0]])
    assert found[:, 1] == pytest.approx(-1000 * G * np.array([1.5, 0.0, 2.0]))
    assert found[:, 0] == pytest.approx(K0 * found[:, 1]) and found[:, 2] == pytest.approx(K0 * found[:, 1])
    assert not found[:, 3].any()
    buried = stress_of([box([0, 0], [1, 2])], [[0.5, 0.5]], surface=3.0)
    assert buried[0, 1] == pytest.approx(-1000 * G * 2.5)


def test_layers_weigh_by_their_density():
    layers = [{"above": 0.5, "material": "b"}, {"above": 1.0, "material": "c"}]
    found = stress_of([box([0, 0], [1, 2], layers=layers)], [[0.5, 0.2], [0.5, 0.7], [0.5, 1.5]])
    expected = [0.3 * 1000 + 0.5 * 2000 + 3000, 0.3 * 2000 + 3000, 0.5 * 3000]
    assert found[:, 1] == pytest.approx(-G * np.array(expected))


def test_a_body_rests_on_another_but_does_not_press_through_air():
    ground, fill = box([0, 0], [4, 1]), box([1, 1], [2, 2.5], material="b")
    x = [[1.5, 0.5], [0.5, 0.5], [1.5, 2.0]]
    found = stress_of([ground, fill], x)
    assert found[:, 1] == pytest.approx(-G * np.array([0.5 * 1000 + 1.5 * 2000, 0.5 * 1000, 0.5 * 2000]))
    for order in (1, -1):  # whichever comes first
        flying = [ground, box([1, 1.3], [2, 2.5], material="b")][::order]
        assert stress_of(flying, x[:2])[:, 1] == pytest.approx(-G * np.array([0.5 * 1000, 0.5 * 1000]))


def test_the_surface_of_a_slope_is_local():
    slope = {"shape": {"type": "polygon", "vertices": [[0, 0], [4, 0], [4, 1], [3, 1], [1, 3], [0, 3]]}}
    found = stress_of([slope], [[0.5, 1.0], [2.0, 1.0], [3.5, 0.4], [1.5, 2.4]])
    assert found[:, 1] == pytest.approx(-1000 * G * np.array([2.0, 1.0, 0.6, 0.1]))
    # below an overhang only what lies between counts
    corners = [[0, 0], [2, 0], [2, 1], [0.5, 1], [0.5, 2], [2, 2], [2, 3], [0, 3]]
    arch = {"shape": {"type": "polygon", "vertices": corners}}
    assert stress_of([arch], [[1.0, 0.5], [0.25, 0.5], [1.0, 2.5]])[:, 1] == pytest.approx(
        -1000 * G * np.array([0.5, 2.5, 0.5])
    )


def test_round_and_extruded_shapes():
    disc = {"shape": {"type": "disc", "center": [0, 0], "radius": 1.0}}
    assert stress_of([disc], [[0.6, 0.2]])[0, 1] == pytest.approx(-1000 * G * 0.6)
    sphere = {"shape": {"type": "sphere", "center": [0, 0, 0], "radius": 1.0}}
    assert stress_of([sphere], [[0.6, 0.0, 0.2]])[0, 2] == pytest.approx(-1000 * G * 0.6)
    for axis, height in (("z", 1.7), ("x", 0.6)):
        cylinder = {"shape": {"type": "cylinder", "base": [0, 0, 0], "axis": axis, "radius": 1.0, "height": 2.0}}
        place = [0.8, 0.0, 0.3] if axis == "z" else [0.3, 0.8, 0.0]
        assert stress_of([cylinder], [place])[0, 2] == pytest.approx(-1000 * G * height)
    prism = {"shape": {"type": "polygon", "vertices": [[0, 0], [2, 0], [0, 2]], "extrude": [0, 1]}}
    assert stress_of([prism], [[0.5, 0.5, 0.25]])[0, 2] == pytest.approx(-1000 * G * 0.75)
    found = stress_of([prism], [[0.5, 0.5, 0.25], [1.5, 1.5, 0.5]], gravity=[0.0, -G, 0.0])
    assert found[0, 1] == pytest.approx(-1000 * G * 1.0) and found[0, 2] == pytest.approx(K0 * found[0, 1])
    assert not found[1].any()  # outside


def test_points_from_a_file(tmp_path):
    x, y = np.meshgrid(np.arange(0.05, 2.0, 0.1), np.arange(0.05, 2.0, 0.1))
    inside = y < 1.0 + 0.5 * x
    rows = np.column_stack([x[inside], y[inside]])
    np.savetxt(tmp_path / "slope.csv", rows, delimiter=",", header="x,y", comments="")
    body = {"shape": {"type": "points", "file": "slope.csv"}}
    places = np.array([[0.4, 0.3], [1.0, 0.3], [1.7, 1.1]])
    found = stress_of([body], places, folder=tmp_path)
    depth = 1.0 + 0.5 * places[:, 0] - places[:, 1]
    assert found[:, 1] == pytest.approx(-1000 * G * depth, abs=0.06 * 1000 * G)  # to half a spacing


def test_oblique_gravity_turns_the_stress_with_it():
    angle = np.radians(20.0)
    gravity = G * np.array([np.sin(angle), -np.cos(angle)])
    found = stress_of([box([0, 0], [50, 1])], [[30.0, 0.25]], gravity=gravity)[0]
    vertical = -1000 * G * 0.75 / np.cos(angle)
    assert found[0] + found[1] == pytest.approx((1 + K0) * vertical)
    assert found[0] * found[1] - found[3] ** 2 == pytest.approx(K0 * vertical**2)
    up = -gravity / G
    assert up @ np.array([[found[0], found[3]], [found[3], found[1]]]) @ up == pytest.approx(vertical)


def test_a_layered_wet_column_starts_in_equilibrium(started, cam_clay_input):
    """The whole way through a scene: out-of-balance forces inside are below the weight of a point."""
    heavy = cam_clay_input | {"grain_density": 2900.0, "porosity": 0.4}
    scene = {
        "dimension": 2, "spacing": 0.01, "gravity": [0.0, -G], "materials": {"low": heavy, "top": cam_clay_input},
        "bodies": [{"name": "column", "material": "low", "layers": [{"above": 0.1, "material": "top"}],
                    "shape": {"type": "box", "lower": [0, 0], "upper": [0.1, 0.2]}}],
        "initial_stress": {"type": "geostatic", "K0": K0},
        "pore_water": {"suction": 20e3, "retention": {"set": "fitted"}},
        "stages": [{"name": "rest", "type": "dynamics", "duration": 1.0}],
    }  # fmt: skip
    sim = started(scene)
    p = sim.particles
    inner = (np.abs(p.position[:, 0] - 0.05) < 0.02) & (np.abs(p.position[:, 1] - 0.1) < 0.07)
    out_of_balance = (p.internal_force + p.external_force)[inner] / (p.mass[inner, None] * G)
    assert np.ptp(p.mass) > 0.03 * p.mass.max()
    assert np.abs(out_of_balance).max() < 0.2  # at the interface of the layers, else rounding
    away = np.abs(p.position[inner, 1] - 0.1) > 0.03
    assert np.abs(out_of_balance[away]).max() < 0.06
