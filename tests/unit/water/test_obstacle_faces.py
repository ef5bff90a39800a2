"""Water at the faces that touch an obstacle: a filter floor, a drain behind a wall, a pipe, what follows the soil."""

import numpy as np
import pytest

from periporo.core.motion.rebuilds import rebuild
from periporo.core.scene.doubts import doubts_about
from periporo.core.water.flow import LEFT, flowing_water
from periporo.errors import InputError
from periporo.io.input.load import parse_scene

SAND = {"model": "elastic", "density": 1590.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
GAMMA, SPEED, H = 9810.0, 1e-3, 0.01
EDGES = {2: 0.002, 3: 0.03}
"""What the area of a face with edges all around may be wrong by, of a few points."""
FLOWING = {"suction": 0, "drainage": "flowing", "porosity": 0.4, "bulk_modulus": 1e6, "conductivity": SPEED}


def floor(dimension, **more):
    normal = [0.0] * (dimension - 1) + [1.0]
    return {"type": "plane", "name": "filter", "point": [0.0] * dimension, "normal": normal, "friction": 0.0} | more


def wall(dimension, x, **more):
    return {"type": "plane", "name": "wall", "point": [x] + [0.0] * (dimension - 1), "friction": 0.0,
            "normal": [-1.0] + [0.0] * (dimension - 1)} | more  # fmt: skip


def held(scene_of, dimension, counts, boundaries, contacts, *, water=FLOWING, duration=1.0, step=0.01, **keys):
    """Grains that stand still, on obstacles."""
    named = {"still": {"where": {"body": "block"}, "fix": list("xyz"[:dimension])}} | boundaries
    stage = {"name": "flow", "type": "dynamics", "duration": duration, "boundaries": list(named)}
    return scene_of(dimension, counts, materials=SAND, contacts=contacts, pore_water=water, boundaries=named,
                    stages=[stage], time_step={"fixed": step}, **keys)  # fmt: skip


def at(obstacle, **kind):
    return {"where": {"body": "block"}, "water": kind | {"obstacle": obstacle}}


def histories(sim):
    return flowing_water(sim).histories()


def faces(sim):
    """Those of the first boundary of the first stage."""
    return sim.stages[0].inflows[0].faces(sim.particles, flowing_water(sim).outer_faces(sim.particles))


@pytest.mark.parametrize("dimension, counts", [(2, (4, 20)), (3, (4, 4, 10))])
def test_a_filter_floor_takes_what_darcy_says(dimension, counts, scene_of, started):
    """Pressure at the floor and a head on top: q = K dh/L through the area that touches it, and no water is lost."""
    height, area = counts[-1] * H, np.prod(counts[:-1]) * H ** (dimension - 1)
    up = "xyz"[dimension - 1]
    top = {"lower": [None] * (dimension - 1) + [height - H]}
    boundaries = {"drain": at("filter", pressure=0.0),
                  "pond": {"where": top, "water": {"head": 2.0 * height, "side": f"{up}+"}}}  # fmt: skip
    sim = started(held(scene_of, dimension, counts, boundaries, [floor(dimension)]))
    sim.run()
    p, before, steps = sim.particles, histories(sim), 5
    assert p.pore_pressure / GAMMA + p.position[:, -1] == pytest.approx(2.0 * p.position[:, -1], abs=0.03 * height)
    for _ in range(steps):
        sim.step()
    after = histories(sim)
    expected = SPEED * 2.0 * area * steps * sim.dt
    assert after["water_outflow"] - before["water_outflow"] == pytest.approx(expected, rel=EDGES[dimension])
    assert after["water_inflow"] - before["water_inflow"] == pytest.approx(expected, rel=EDGES[dimension])
    assert abs(after["water_balance"]) < 1e-12 * after["water_stored"] * 400


@pytest.mark.parametrize("dimension, counts", [(2, (6, 10)), (3, (5, 4, 6))])
def test_a_drain_behind_a_wall(dimension, counts, scene_of, started):
    """`rain: 0` lets water out below the table only; a flux enters through the whole face, and no other."""
    side, height = 0.5 * counts[0] * H, counts[-1] * H
    width = H ** (dimension - 2) * np.prod(counts[1:-1])
    contacts = [floor(dimension), wall(dimension, side)]
    table = {"water_table": 0.5 * height, "largest_suction": 500.0}
    water = {k: v for k, v in FLOWING.items() if k != "suction"} | table
    curve = {"retention": {"van_genuchten": {"alpha": 1.0, "n": 2.0}}}
    sim = started(held(scene_of, dimension, counts, {"drain": at("wall", rain=0)}, contacts, water=water | curve,
                       step=1e-4))  # fmt: skip
    p, found = sim.particles, faces(sim)
    assert len(found.rows) == np.prod(counts[1:]) and (p.position[found.rows, 0] > side - H).all()
    assert found.area.sum() == pytest.approx(width * height, rel=EDGES[dimension])
    assert found.normal[:, 0] == pytest.approx(1.0)
    sim.inflows = sim.stages[0].inflows
    sim.step()
    left = p.exchanged_water[:, LEFT] > 0.0
    assert left.any() and (p.position[left, -1] < 0.5 * height).all() and (p.position[left, 0] > side - H).all()
    flux = {"flux": {"times": [0, 1], "values": [SPEED, SPEED]}}
    sim = started(held(scene_of, dimension, counts, {"well": at("wall", **flux)}, contacts, step=1e-4))
    before = histories(sim)["water_inflow"]
    sim.inflows = sim.stages[0].inflows
    sim.step()
    gained = histories(sim)["water_inflow"] - before
    assert gained == pytest.approx(SPEED * width * height * sim.dt, rel=EDGES[dimension])


def test_faces_follow_soil_and_obstacle(scene_of, started):
    """Soil that leaves a wall has no face there any more; a round pipe has the faces around it."""
    boundaries = {"drain": at("wall", pressure=0.0)}
    sim = started(held(scene_of, 2, (6, 6), boundaries, [wall(2, 0.03)], gravity=None))
    p = sim.particles
    assert len(faces(sim).rows) == 6
    p.position[:, 0] -= 0.5 * H
    rebuild(sim)
    sim.evaluate_forces()
    assert len(faces(sim).rows) == 0
    p.position[:, 0] += 0.45 * H
    assert len(faces(sim).rows) == 6
    hole = {"type": "disc", "name": "wall", "center": [0.0, 0.1], "radius": 0.04, "friction": 0.0}
    body = {"name": "block", "material": "soil",
            "shape": {"type": "polygon", "vertices": [[-0.1, 0.0], [0.1, 0.0], [0.1, 0.06], [-0.1, 0.06]]}}  # fmt: skip
    sim = started(held(scene_of, 2, (6, 6), boundaries, [hole], bodies=[body]))
    p = sim.particles
    rows = faces(sim).rows
    gap = np.sqrt(((p.position[rows] - [0.0, 0.1]) ** 2).sum(axis=1)) - 0.04
    assert 2 <= len(rows) < 20 and gap.max() < 0.75 * H


def test_what_obstacles_need_is_said(scene_of, started):
    """Names that exist, obstacles that are there, no rain under them; a doubt where no soil touches one."""
    for water, contacts, message in (
        ({"obstacle": "flter", "pressure": 0.0}, [floor(2)], "there is no named obstacle 'flter'"),
        ({"obstacle": "filter", "pressure": 0.0}, [floor(2, name=None)], "there is no named obstacle 'filter'"),
        ({"obstacle": "filter", "side": "y-", "head": 0.0}, [floor(2)], "give side or obstacle, not both"),
        ({"obstacle": "filter", "rain": 1e-6}, [floor(2)], "no rain falls where soil touches an obstacle"),
    ):
        with pytest.raises(InputError, match=message.replace(" ", r"\s+")):
            parse_scene(held(scene_of, 2, (4, 4), {"drain": {"where": {"body": "block"}, "water": water}}, contacts))
    stages = [{"name": name, "type": "dynamics", "duration": 1e-3, "boundaries": ["drain"]} for name in ("a", "b")]
    scene = scene_of(counts=(4, 4), materials=SAND, pore_water=FLOWING, contacts=[floor(2, stages=["a"])],
                     boundaries={"drain": at("filter", pressure=0.0)}, stages=stages)  # fmt: skip
    with pytest.raises(InputError, match=r"the\s+obstacle\s+'filter'\s+is\s+not\s+there\s+in\s+this\s+stage"):
        parse_scene(scene)
    scene = held(scene_of, 2, (4, 4), {"drain": at("wall", pressure=0.0)}, [wall(2, 0.5)])
    assert any("no soil touches the obstacle 'wall'" in d for d in doubts_about(parse_scene(scene), started(scene)))
