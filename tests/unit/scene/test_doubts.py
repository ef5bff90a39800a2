"""What `periporo check` doubts, and that it doubts nothing else."""

import numpy as np
import pytest
from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.core.scene.doubts import _weight_above, doubts_about
from periporo.errors import InputError
from periporo.io.input.load import parse_scene


def doubts(scene):
    parsed = parse_scene(scene)
    sim = build(parsed, MPI.COMM_SELF)
    sim.start()
    return doubts_about(parsed, sim)


def test_a_sound_scene_leaves_none(scene_of):
    assert doubts(scene_of()) == []


def test_outputs_that_one_rank_would_write_for_long(scene_of, monkeypatch):
    scene = scene_of(output={"fields": ["stress", "velocity", "material"]})
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    size = 8 * (1 + 3 + 6 + 3 + 1) * sim.particles.owned  # id, place and fields, as they are stored
    monkeypatch.setattr("periporo.core.scene.doubts._LARGE", size + 1)
    assert doubts(scene) == []
    monkeypatch.setattr("periporo.core.scene.doubts._LARGE", size)
    (text,) = doubts(scene)
    assert text.startswith(f"an output has {size / 1e9:.2g} GB, and rank 0 writes it alone")
    scene["output"]["parts"] = 2
    assert doubts(scene) == []


def test_soft_soil_is_judged_by_the_soil_above_it(scene_of):
    """Two blocks on the same floor level, one of them on a terrace: 0.24 m stand there, not 1.2 m."""
    soft = {"model": "elastic", "density": 2000.0, "bulk_modulus": 5e4, "shear_modulus": 3e4}
    scene = scene_of(materials=soft, spacing=0.02, contacts=[])
    boxes = [([0.0, 0.0], [0.2, 0.24]), ([0.3, 1.0], [0.5, 1.2])]
    scene["bodies"] = [{"name": f"b{k}", "material": "soil", "shape": {"type": "box", "lower": low, "upper": up}}
                       for k, (low, up) in enumerate(boxes)]  # fmt: skip
    (text,) = doubts(scene)
    assert text.startswith("the weight of 0.23 m of soil is 0.09 of the bulk modulus, 5e+04 Pa, of material 'soil'")
    parsed = parse_scene(scene)
    sim = build(parsed, MPI.COMM_SELF)
    sim.start()
    p = sim.particles
    top = np.where(p.body == 0, 0.24, 1.2)
    assert _weight_above(sim, parsed) == pytest.approx(2000.0 * 9.81 * (top - p.position[:, 1]), rel=1e-9)


def test_histories_that_are_over_before_their_stage(scene_of):
    history = {"times": [0.0, 1e-3], "values": [0.0, 1e-3]}
    scene = scene_of(boundaries={"push": {"where": {"upper": [None, 0.01]}, "displacement": {"x": history}}})
    scene["stages"] = [{"name": "wait", "type": "dynamics", "duration": 2e-3},
                       {"name": "push", "type": "dynamics", "duration": 2e-3, "boundaries": ["push"]}]  # fmt: skip
    (text,) = doubts(scene)
    assert "boundary 'push' ends at 0.001 s, before stage 'push' begins at 0.002 s" in text
    scene["stages"][0] |= {"type": "relax", "name": "settle"}
    scene["stages"][0].pop("duration")
    assert doubts(scene) == []  # a relaxation takes no time


@pytest.mark.parametrize("motion", ["velocity", "displacement", "rotation"])
def test_histories_of_obstacles_that_are_over_before_they_appear(scene_of, motion):
    """One that is used from the start, and only goes on to hold, is not doubted; nor is a constant."""
    history = {"times": [0.0, 1e-3], "values": [1e-4, 0.0]}
    parts = {"rate": history} if motion == "rotation" else {"y": history}
    plate = {"type": "box", "lower": [0.4, 0.0], "upper": [0.6, 0.1], "friction": 0.0, "stages": ["push"]}
    scene = scene_of(contacts=[plate | {motion: parts}])
    scene["stages"] = [{"name": name, "type": "dynamics", "duration": 2e-3} for name in ("wait", "push")]
    (text,) = doubts(scene)
    assert text.startswith(f"the {motion} of contacts[0] (box) ends at 0.001 s, before stage 'push' begins at 0.002 s")
    scene["contacts"][0]["stages"] = ["wait", "push"]
    assert doubts(scene) == []
    scene["contacts"] = [plate | {"velocity": {"y": 0.1}}]
    assert doubts(scene) == []


def test_a_stage_that_cannot_come_to_rest(scene_of):
    scene = scene_of(boundaries={"drag": {"where": {"upper": [None, 0.01]}, "velocity": {"x": 0.1}}})
    scene["stages"][0] |= {"boundaries": ["drag"], "stop_when_at_rest": 1e-3}
    assert doubts(scene) == ["stage 'fall' is to stop at rest, but boundary 'drag' moves until its end"]


def test_a_contact_that_sets_the_step(scene_of):
    scene = scene_of()
    scene["contacts"].append(scene["contacts"][0] | {"stiffness": 1e13, "stages": ["fall"]})
    (text,) = doubts(scene)
    assert text.startswith("the stiffness of contacts[1] (plane), 1e+13 N/m^3, makes the time step ")


def test_an_obstacle_thinner_than_a_spacing(scene_of):
    scene = scene_of()
    plate = {"type": "box", "lower": [0.06, 0.0], "upper": [0.0699, 0.1], "friction": 0.0}
    scene["contacts"].append(plate)
    (text,) = doubts(scene)
    assert text.startswith("contacts[1] (box) is 0.0099 m thick, less than a spacing")
    plate["upper"][0] = 0.07
    assert doubts(scene) == []


@pytest.mark.parametrize("kind", ["box", "short_range_published"])
@pytest.mark.parametrize("stage", ["first", "later"])
def test_obstacles_that_appear_in_soil_are_refused_whatever_the_stage(scene_of, kind, stage):
    scene = scene_of(contacts=[])
    scene["stages"] = [{"name": name, "type": "dynamics", "duration": 1e-3} for name in ("first", "later")]
    contact = {"type": kind, "stages": [stage]}
    if kind == "box":
        contact |= {"lower": [-0.02, 0.06], "upper": [0.02, 0.2], "friction": 0.1}
    else:
        contact |= {"substrate": {"lower": [-0.02, 0.06], "upper": [0.02, 0.2]}}
    scene["contacts"] = [contact]
    with pytest.raises(InputError, match=r"contacts\[0\]: the body 'block' reaches 0\.0.* m into this"):
        doubts(scene)
    contact["cleared"] = True
    if stage == "later":
        doubts(scene)
    else:
        with pytest.raises(InputError, match="reaches"):
            doubts(scene)


def test_a_permeability_in_the_wrong_unit(scene_of):
    elastic = {"model": "elastic", "density": 1600.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    water = {"suction": 0, "drainage": "flowing", "porosity": 0.4, "bulk_modulus": 1e7, "viscosity": 1e3}
    (text,) = doubts(scene_of(materials=elastic, pore_water=water | {"permeability": 1e-5}))
    assert "1e-05 m^2 is more than that of gravel; is it a conductivity in m/s?" in text
    (text,) = doubts(scene_of(materials=elastic, pore_water=water | {"conductivity": 1e-14}))
    assert "1e-14 m/s is less than that of any clay; is it a permeability in m^2?" in text


def test_strange_rain_and_water_tables(scene_of):
    """Rain in mm/h, from below, and a boundary that no stage names; a table in the air, and one that wets nothing."""
    elastic = {"model": "elastic", "density": 1600.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    water = {"drainage": "flowing", "porosity": 0.4, "bulk_modulus": 1e7, "conductivity": 1e-9}
    scene = scene_of(materials=elastic, pore_water=water | {"suction": 0})
    rain = {"rain": {"where": {"body": "block"}, "water": {"rain": 20.0, "side": "y-"}}}
    unit, below, idle = doubts(scene | {"boundaries": rain})
    assert "a rain of 20 m/s is more than ever fell" in unit and "is it in mm/h?" in unit
    assert "no rain falls on faces that look to y-" in below and "no stage names boundary 'rain'" in idle
    (text,) = doubts(scene | {"pore_water": water | {"water_table": 5.0}})
    assert "is 4.9" in text and "give free_water, or a lower water_table" in text
    table = {"water_table": 0.02, "retention": {"van_genuchten": {"alpha": 0.1, "n": 2.0}}}
    (text,) = doubts(scene | {"pore_water": water | table})
    assert "full and without pressure, since largest_suction is 0" in text
    assert doubts(scene | {"pore_water": water | table | {"largest_suction": 1e3}}) == []


def test_round_bodies_that_a_lattice_gives_another_volume(scene_of):
    disc = {"name": "disc", "material": "soil", "shape": {"type": "disc", "center": [0.0, 0.04], "radius": 0.04}}
    scene = scene_of(spacing=0.01, bodies=[disc])
    (text,) = doubts(scene)
    assert text.startswith("the points of body 'disc' have 1.03 times the volume of its shape")
    assert doubts(scene | {"bodies": [disc | {"lattice": "rings"}]}) == []
