"""Parameters that vary from place to place: values, the laws of rows, refusals, what is written."""

import math

import numpy as np
import pytest

from periporo import InputError, Simulation, open_results, run
from periporo.core.points import fields
from periporo.core.points.varied import VariedLaw
from periporo.core.scene.check import check_scene
from periporo.io.geometry.fields import field_values
from periporo.io.schema.fields import read_field
from periporo.materials import Material
from periporo.materials.arena import Arena
from periporo.materials.cam_clay import CamClay
from periporo.materials.drucker_prager import DruckerPrager
from periporo.materials.elastic import Elastic
from periporo.materials.granular_mu_i import GranularMuI
from periporo.materials.herschel_bulkley import HerschelBulkley
from periporo.materials.hypoplastic_sand import HypoplasticSand
from periporo.materials.mohr_coulomb import MohrCoulomb
from periporo.materials.norsand import NorSand

SAND = {"model": "drucker_prager", "density": 1600.0, "bulk_modulus": 2e6, "shear_modulus": 1e6,
        "friction_angle": 20.0, "cohesion": 500.0}  # fmt: skip
RANDOM = {"field": "random", "mean": 1000.0, "variation": 0.4, "length": [0.05, 0.02], "seed": 4}


def scene(spacing=0.01, **varied):
    return {
        "dimension": 2, "spacing": spacing, "gravity": [0.0, -9.81], "materials": {"sand": SAND | varied},
        "bodies": [{"name": "b", "material": "sand", "shape": {"type": "box", "lower": [0, 0], "upper": [0.12, 0.1]}}],
        "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.3}],
        "stages": [{"name": "fall", "type": "dynamics", "duration": 2e-3}],
    }  # fmt: skip


def points_of(data, name="parameter_cohesion"):
    p = Simulation.from_scene(data).particles
    return p.position[: p.owned], getattr(p, name)[: p.owned]


def test_a_field_that_does_not_vary_is_a_number():
    """The same motion, but for rounding: each row is returned by a call of its own."""
    one, other = (Simulation.from_scene(scene(**v)) for v in ({}, {"cohesion": {"field": "depth", "at": [0.0],
                                                                              "values": [500.0]}}))  # fmt: skip
    for sim in (one, other):
        sim.run()
    p, q = one.particles, other.particles
    assert np.abs(p.position[: p.owned] - q.position[: q.owned]).max() < 1e-12


def test_depth_and_level_are_linear_between_values():
    """Depth counts from the surface at .1 m, also under a step in it."""
    data = scene(cohesion={"field": "depth", "at": [0.02, 0.06], "values": [200.0, 600.0]},
                 friction_angle={"field": "level", "at": [0.0, 0.1], "values": [30.0, 20.0]})  # fmt: skip
    shape = {"type": "polygon", "vertices": [[0, 0], [0.12, 0], [0.12, 0.05], [0.06, 0.05], [0.06, 0.1], [0, 0.1]]}
    data["bodies"][0]["shape"] = shape
    x, cohesion = points_of(data)
    depth = np.where(x[:, 0] < 0.06, 0.1, 0.05) - x[:, 1]
    np.testing.assert_allclose(cohesion, 200.0 + 1e4 * np.clip(depth - 0.02, 0.0, 0.04), rtol=1e-8)
    _, angle = points_of(data, "parameter_friction_angle")
    np.testing.assert_allclose(angle, 30.0 - 100.0 * x[:, 1], rtol=1e-8)


def test_rasters_and_points(tmp_path):
    (tmp_path / "soil.csv").write_text("x,y,c\n0,0,100\n0.12,0,300\n0,0.1,200\n0.12,0.1,400\n")
    np.save(tmp_path / "angle.npy", np.add.outer(np.arange(3.0), 10 * np.arange(4.0)))
    x, cohesion = points_of(scene(cohesion={"field": "points", "file": str(tmp_path / "soil.csv"), "column": "c"}))
    np.testing.assert_array_equal(cohesion, 100.0 + 200.0 * (x[:, 0] > 0.06) + 100.0 * (x[:, 1] > 0.05))
    raster = {"field": "raster", "file": str(tmp_path / "angle.npy"), "corner": [0, 0], "cell": [0.05, 0.06],
              "first_row": "south", "registration": "corner"}  # fmt: skip
    x, angle = points_of(scene(friction_angle=raster), "parameter_friction_angle")
    np.testing.assert_allclose(angle, 10 * x[:, 0] / 0.05 + x[:, 1] / 0.06, rtol=1e-8)


def of_random(position, **changed):
    return field_values(read_field(RANDOM | changed, "."), position, lambda x: -x[:, 1], lambda x: x[:, 1])


def test_random_fields_have_their_statistics():
    """Mean, deviation and correlation at a correlation length along each axis, over 300 fields."""
    place = np.array([[0.0, 0.0], [0.05, 0.0], [0.0, 0.02]])
    draws = np.array([of_random(place, seed=k) for k in range(300)])
    logs = np.log(draws)
    assert draws.mean() == pytest.approx(1000.0, rel=0.05)
    assert logs.std() == pytest.approx(math.sqrt(math.log(1.16)), rel=0.1)
    correlation = np.corrcoef(logs.T)
    assert correlation[0, 1] == pytest.approx(math.exp(-1.0), abs=0.14)
    assert correlation[0, 2] == pytest.approx(math.exp(-1.0), abs=0.14)


def test_a_value_belongs_to_its_place():
    """Whatever others are asked for: to the bit, for points lie on any rank."""
    place = np.random.default_rng(1).uniform(size=(500, 2))
    whole = of_random(place)
    parts = np.concatenate([of_random(place[k : k + 7]) for k in range(0, 500, 7)])
    np.testing.assert_array_equal(whole, parts)
    trend = {"field": "depth", "at": [-1, 0], "values": [2000.0, 1000.0]}
    np.testing.assert_allclose(of_random(place, mean=trend), whole * (1.0 + place[:, 1]), rtol=1e-12)


LAWS = [
    (Elastic.example(), {"bulk_modulus": (1e7, 3e7), "shear_modulus": (5e6, 9e6)}),
    (DruckerPrager.example(), {"cohesion": (1e2, 1e4), "friction_angle": (20.0, 40.0)}),
    (CamClay.example(), {"critical_state_slope": (0.8, 1.3), "viscosity": (10.0, 1e3)}),
    (CamClay.example().model_copy(update={"bulk_modulus": None, "shear_modulus": None, "poisson_ratio": 0.3}),
     {"poisson_ratio": (0.1, 0.4), "swelling_index": (0.02, 0.06)}),
    (HypoplasticSand.example(), {"initial_void_ratio": (0.6, 0.9), "hardness": (5e8, 2e9)}),
    (GranularMuI.example(), {"static_friction": (0.3, 0.4), "grain_diameter": (1e-4, 1e-3)}),
    (HerschelBulkley.example(), {"yield_stress": (50.0, 300.0), "exponent": (0.4, 1.2)}),
    (NorSand.example(), {"initial_state_parameter": (-0.2, 0.1), "critical_state_slope": (1.1, 1.4)}),
    (MohrCoulomb.example(), {"cohesion": (1e2, 1e4), "friction_angle": (20.0, 40.0)}),
    (MohrCoulomb.example().model_copy(update={"sensitivity": 5.0, "remoulding_shear": 0.1}),
     {"cohesion": (1e3, 1e4), "shear_modulus": (5e6, 9e6), "sensitivity": (2.0, 10.0)}),
    (Arena(), {"FSLOPE": (0.32, 0.5)}),
]


@pytest.mark.parametrize("components", [4, 6])
@pytest.mark.parametrize("law, bounds", LAWS, ids=lambda v: type(v).__name__)
def test_each_row_follows_its_own_law(law, bounds, components):
    """As the law does with the row alone, to rounding, by which Arena may take other substeps."""
    close = 1e-4 if isinstance(law, Arena) else 1e-12
    rng, n = np.random.default_rng(3), 12
    names = tuple(bounds)
    values = np.stack([rng.uniform(*bounds[name], n) for name in names], axis=1)
    values[5:8] = values[4]

    def make(row):
        return type(law)(**law.model_dump(exclude_unset=True) | dict(zip(names, row, strict=True)))

    varied = VariedLaw(law, names, make).for_rows(values)
    assert isinstance(varied, Material)
    stress = rng.normal(size=(n, components)) * 1e3
    stress[:, :3] -= 2e4
    ids = np.stack([np.arange(n)] * 2, axis=1)
    state = varied.initial_state(stress.copy(), ids, np.full(n, 1e-3))
    strain = rng.normal(size=(n, components)) * 2e-3
    after, kept = stress.copy(), state.copy()
    varied.compute_stress(after, strain.copy(), kept, 1e-3)
    moduli = varied.elastic_moduli(after, kept)
    for k in range(n):
        own = make(values[k])
        row, memory = stress[k : k + 1].copy(), state[k : k + 1].copy()
        np.testing.assert_array_equal(
            memory, own.initial_state(row.copy(), ids[k : k + 1], np.full(1, 1e-3))
        )  # fmt: skip
        own.compute_stress(row, strain[k : k + 1].copy(), memory, 1e-3)
        np.testing.assert_allclose(after[k : k + 1], row, rtol=close, atol=1e-9)
        np.testing.assert_allclose(kept[k : k + 1], memory, rtol=close, atol=1e-15)
        for mine, whole in zip(own.elastic_moduli(row, memory), moduli, strict=True):
            np.testing.assert_allclose(whole[k], mine[0], rtol=close)
    weaker = varied.weakened(1.3) if hasattr(law, "weakened") else None
    if weaker is not None:
        assert weaker.part([3]).law(values[3]) == make(values[3]).weakened(1.3)


def test_what_a_law_refuses_is_told_with_place_and_value():
    normal = RANDOM | {"distribution": "normal", "variation": 1.0}
    with pytest.raises(InputError, match=r"materials.sand.cohesion: at \(0\.\d+, 0\.\d+\) m, cohesion = -\d") as e:
        Simulation.from_scene(scene(cohesion=normal))
    assert "at least 0" in str(e.value)
    steep = {"field": "level", "at": [0.0, 0.05, 0.1], "values": [0.0, 5.0, 25.0]}
    with pytest.raises(InputError, match=r"dilation_angle = 2\d.*must not exceed"):
        Simulation.from_scene(scene(dilation_angle=steep))
    with pytest.raises(InputError, match=r"with\s+cohesion = -5 at the level 0.1 m"):  # before there are points
        Simulation.from_scene(scene(cohesion={"field": "level", "at": [0.0, 0.1], "values": [5.0, -5.0]}))


@pytest.mark.parametrize(
    "field, words",
    [
        ({"field": "depht", "at": [0.0], "values": [1.0]}, "cohesion.field: .*'depth'"),
        ({"field": "depth", "at": [0.0, 0.0], "values": [1.0, 2.0]}, "must increase"),
        ({"field": "depth", "at": [0.0], "values": [1.0, 2.0]}, "1 places but 2 values"),
        ({"field": "points", "file": "no.csv", "column": "c"}, "no regular file"),
        ({"field": "random", "mean": 1.0, "deviation": 1.0, "variation": 1.0, "length": 1.0}, "exactly one of"),
        ({"field": "random", "mean": 1.0, "deviation": 1.0, "length": [1.0]}, "2 components"),
        ({"field": "random", "mean": -1.0, "deviation": 1.0, "length": 1.0}, "mean greater than 0"),
    ],
)
def test_bad_fields_are_refused(field, words):
    with pytest.raises(InputError, match=words):
        Simulation.from_scene(scene(cohesion=field))


def test_fields_along_gravity_need_it():
    data = scene(cohesion={"field": "depth", "at": [0.0], "values": [1.0]})
    del data["gravity"]
    with pytest.raises(InputError, match="need gravity"):
        Simulation.from_scene(data)


def test_a_varying_density_makes_the_mass(tmp_path):
    table = {"field": "level", "at": [0.0, 0.1], "values": [2000.0, 1000.0]}
    p = Simulation.from_scene(scene(density=table)).particles
    density = p.mass[: p.owned] / p.volume[: p.owned]
    np.testing.assert_allclose(density, 2000.0 - 1e4 * p.position[: p.owned, 1], rtol=1e-8)
    with pytest.raises(InputError, match="density may not vary"):
        Simulation.from_scene(scene(density=table) | {"initial_stress": {"type": "geostatic"}})


def test_results_hold_them_and_check_prints_the_range(tmp_path, monkeypatch, capsys):
    from mpi4py import MPI

    from periporo.io.pictures.plots import plot_deposit

    monkeypatch.chdir(tmp_path)
    data = scene(cohesion=RANDOM)
    with open_results(run(data, "random.vtkhdf", quiet=True)) as results:
        cohesion = results.field("parameter_cohesion", step=-1)
        assert results.unit("parameter_cohesion") == "Pa" and cohesion.std() > 100.0
        np.testing.assert_array_equal(cohesion, results.field("parameter_cohesion", step=0))
        plot_deposit(results, tmp_path / "cohesion.png", field="parameter_cohesion")
    assert (tmp_path / "cohesion.png").stat().st_size > 5000
    check_scene(data, MPI.COMM_SELF)
    said = capsys.readouterr().out
    assert f"sand, cohesion: {cohesion.min():.4g} to {cohesion.max():.4g} at 120 points" in said
    assert "parameter_cohesion" in fields.available(Simulation.from_scene(data))
