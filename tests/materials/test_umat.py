"""Laws of others: Fortran and C give what the built-in laws give; what does not suit is refused."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

import periporo
from periporo.core.points.material import state_column
from periporo.materials import StepRefused, check_material
from periporo.materials.drucker_prager import DruckerPrager
from periporo.materials.elastic import Elastic
from periporo.materials.laboratory.point import MaterialPoint
from periporo.materials.testing import FrameError
from periporo.materials.umat import UTILITIES, Umat

SOURCES = Path(__file__).parent / "data" / "umat"
K, MU = 25e6, 15e6
BUILT_IN = DruckerPrager(
    density=1700.0, bulk_modulus=K, shear_modulus=MU, cohesion=5e3, friction_angle=30.0, dilation_angle=10.0,
    match="compression", report_dissipation=True,
)  # fmt: skip
needs_c = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler (cc) on this machine")
needs_fortran = pytest.mark.skipif(shutil.which("gfortran") is None, reason="there is no gfortran on this machine")


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Function that compiles sources into a library, once."""
    folder, done = tmp_path_factory.mktemp("umat"), {}

    def compile_them(compiler, *sources):
        if sources not in done:
            library = folder / f"{Path(sources[0]).stem}_{compiler}_{len(sources)}.so"
            options = ["-shared", "-fPIC", "-O2", "-o", str(library)]
            subprocess.run([compiler, *options, *map(str, sources), "-lm"], check=True)
            done[sources] = str(library)
        return done[sources]

    return compile_them


def fortran(compiled, **changes):
    return Umat(density=1700.0, library=compiled("gfortran", SOURCES / "elastic.f90"), props=[K, MU], **changes)


def soil(compiled, **changes):
    eta, strength, dilation = BUILT_IN.cone(3)
    library = compiled("cc", SOURCES / "drucker_prager.c")
    parameters = {
        "density": 1700.0, "library": library, "props": [K, MU, eta, strength, dilation], "state_variables": 1,
        "largest_mean_stress": strength / eta, "report_dissipation": True,
    }  # fmt: skip
    return Umat(**(parameters | changes))


def nosy(compiled, number, longest=1.0, state_variables=3, **changes):
    library = compiled("cc", SOURCES / "nosy.c", UTILITIES)
    parameters = {"props": [K, MU, number, longest], "state_variables": state_variables} | changes
    return Umat(density=1700.0, library=library, **parameters)


def random_rows(components, n=500, seed=3):
    rng = np.random.default_rng(seed)
    stress = np.zeros((n, components))
    stress[:, :3] = -rng.uniform(0, 5e4, (n, 1))
    return stress, rng.normal(size=(n, components)) * 10 ** rng.uniform(-6, -2, (n, 1))


def same(first, second, components):
    stress, increment = random_rows(components)
    results = []
    for law in (first, second):
        new, state = stress.copy(), law.initial_state(stress.copy(), np.zeros((500, 2), int), np.ones(500))
        for _ in range(3):
            law.compute_stress(new, increment, state, 1e-3)
        results.append((new, state[:, -1 if law is first else 0]))
    scale = K * np.abs(increment).max(axis=1, keepdims=True) + np.abs(stress).max(axis=1, keepdims=True)
    assert (np.abs(results[0][0] - results[1][0]) / scale).max() < 1e-14
    return results


@needs_fortran
@pytest.mark.parametrize("components", [4, 6])
def test_fortran_equals_the_elastic_law(compiled, components):
    law, built_in = fortran(compiled), Elastic(density=1700.0, bulk_modulus=K, shear_modulus=MU)
    stress, increment = random_rows(components)
    mine, state = stress.copy(), np.zeros((500, 0))
    law.compute_stress(mine, increment, state, 1e-3)
    built_in.compute_stress(stress, increment, state, 1e-3)
    assert np.abs(mine - stress).max() < 1e-14 * np.abs(stress).max()
    for found, wanted in zip(law.elastic_moduli(stress, state), (K, MU), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-14)
    assert abs(check_material(law, 2 if components == 4 else 3).cycle_energy) < 1e-9


@needs_c
@pytest.mark.parametrize("components", [4, 6])
def test_c_equals_drucker_prager_and_conforms(compiled, components):
    law = soil(compiled)
    (_, dissipated), (_, expected) = same(law, BUILT_IN, components)
    np.testing.assert_allclose(dissipated, expected, rtol=1e-9, atol=1e-9)
    assert (expected > 0).any()
    assert check_material(law, 2 if components == 4 else 3).cycle_energy > 0.0


@needs_c
def test_a_scene_gives_the_same_stress_with_a_law_of_others(compiled):
    """An elastic block that hits the floor askew, in plane strain."""
    stresses = []
    built_in = Elastic(density=1700.0, bulk_modulus=K, shear_modulus=MU)
    for name, law in (("umat", nosy(compiled, 0)), ("elastic", built_in)):
        parameters = {k: list(v) if isinstance(v, tuple) else v for k, v in law.model_dump(exclude_none=True).items()}
        simulation = periporo.Simulation.from_scene({
            "dimension": 2, "spacing": 0.01, "gravity": [0, -9.81], "correspondence": "bond_projected",
            "materials": {"soil": {"model": name} | parameters},
            "bodies": [{"name": "block", "material": "soil", "velocity": [0.5, -1.0],
                        "shape": {"type": "box", "lower": [0, 0], "upper": [0.1, 0.05]}}],
            "contacts": [{"type": "plane", "point": [0, 0], "normal": [0, 1], "friction": 0.5}],
            "stages": [{"name": "hit", "type": "dynamics", "duration": 2e-3}],
        })  # fmt: skip
        simulation.run()
        stresses.append(simulation.bonds.blocks[0].stress.copy())
    assert np.abs(stresses[0]).max() > 1e3
    assert np.abs(stresses[0] - stresses[1]).max() < 1e-9 * np.abs(stresses[0]).max()


@needs_c
def test_what_a_law_reads_is_given_or_refused(compiled):
    with pytest.raises(ValidationError, match="reads TEMP; the program does not know it"):
        nosy(compiled, 1)
    for number, (word, argument) in enumerate((("strain", "STRAN"), ("length", "CELENT"), ("time", "TIME")), 2):
        with pytest.raises(ValidationError, match=rf"reads {argument}; write reads: \[{word}\]"):
            nosy(compiled, number)
        law = nosy(compiled, number, reads=[word])
        stress = np.zeros((1, 6))
        state = law.initial_state(stress, np.zeros((1, 2), int), np.full(1, 8.0))
        assert state[0, :3].tolist() == [1.0, 2.0, 3.0]  # of SDVINI
        for time in (0.5, 1.0):  # of the end of a step, which the program tells
            if word == "time":
                state[0, state_column(law, word, 6)] = time
            law.compute_stress(stress, np.array([[0, 0, 0, 1e-3, 0, 0]]), state, 0.5)
        assert state[0, 1] == pytest.approx({"strain": 2e-3, "length": 2.0, "time": 0.5}[word], rel=1e-12)
        assert state[0, 0] == pytest.approx(np.sqrt(3) * 2 * MU * 2e-3, rel=1e-12)  # SINV of the utilities


@needs_c
def test_too_few_props_or_state_variables_are_found_out(compiled):
    """Behind both stand numbers that are none, such as a second modulus where there is one."""
    with pytest.raises(ValidationError, match="are props and state_variables those of the law"):
        nosy(compiled, 0, props=[K])
    with pytest.raises(ValidationError, match="DDSDDE at no stress gives bulk and shear modulus 0 and 0 Pa"):
        nosy(compiled, 0, props=[0.0, 0.0, 0.0, 1.0])


@needs_c
def test_place_and_deformation_gradient_are_those_of_the_step(compiled):
    """In shear by 1e-3 a step the law hears of F12, whole, and of a half when it asked for half of the step."""
    with pytest.raises(ValidationError, match=r"reads DFGRD0; write reads: \[deformation_gradient\]"):
        nosy(compiled, 8)
    point = MaterialPoint(nosy(compiled, 8, reads=["deformation_gradient"]), np.zeros(6))
    for number in range(3):
        shear = [np.array([[1.0, 1e-3 * k, 0], [0, 1, 0], [0, 0, 1]]) for k in (number, number + 1)]
        point.deform(*shear, 1.0)
        assert point.state[0, 1] == pytest.approx(1e-3 if number else 0.5e-3, rel=5e-3)  # the first turn comes later
    with pytest.raises(ValidationError, match=r"reads COORDS; write reads: \[place\]"):
        nosy(compiled, 7)
    law = nosy(compiled, 7, reads=["place"])
    stress = np.zeros((1, 6))
    state = law.initial_state(stress, np.zeros((1, 2), int), np.ones(1))
    state[0, state_column(law, "place", 6) + 1] = 7.0
    law.compute_stress(stress, np.array([[0, 0, 0, 1e-3, 0, 0]]), state, 0.5)
    assert state[0, 1] == 7.0


@needs_c
@pytest.mark.parametrize("number, key", [(5, "strain_tensors"), (6, "tensors")])
def test_tensors_among_the_state_variables_are_turned(compiled, number, key):
    """Strain that the law adds up behind a number; the kit turns the axes."""
    law = nosy(compiled, number, state_variables=2, initial_state_variables=[3.0, 0.5], **{key: [2]})
    for components in (4, 6):
        stress, increment = random_rows(components, 3)
        state = law.initial_state(stress, np.zeros((3, 2), int), np.ones(3))
        law.compute_stress(stress, increment, state, 1.0)
        expected = increment + 0.5 * (np.arange(components) < 3)
        np.testing.assert_allclose(state, np.hstack([np.full((3, 1), 3.0), expected]), rtol=1e-13)
        check_material(law, 2 if components == 4 else 3)
    with pytest.raises(FrameError):
        check_material(nosy(compiled, number, state_variables=7), 3)


@needs_c
def test_a_law_that_wants_shorter_steps_gets_them_up_to_a_limit(compiled):
    law, stress = nosy(compiled, 0, longest=1e-3), np.zeros((2, 4))
    state = law.initial_state(stress, np.zeros((2, 2), int), np.ones(2))
    law.compute_stress(stress, np.array([[0.0, 5e-3, 0, 0], [0, 5e-4, 0, 0]]), state, 1.0)
    assert stress[0, 1] == pytest.approx(10 * stress[1, 1], rel=1e-13)
    with pytest.raises(StepRefused, match="PNEWDT") as refusal:
        law.compute_stress(stress, np.array([[0, 0, 0, 0], [0.5, 0, 0, 0]]), state, 1.0)
    assert refusal.value.rows.tolist() == [1]


@needs_c
def test_a_search_for_a_factor_of_safety_divides_the_props_that_are_named(compiled):
    """eta and xi c of the cone: in shear at no volume change the strength falls by the factor."""
    law, reached = soil(compiled, strength_props=[3, 4]), []
    for weaker in (law, law.weakened(2.0)):
        stress = np.array([[-1e4, -1e4, -1e4, 0.0]])
        state = weaker.initial_state(stress.copy(), np.zeros((1, 2), int), np.ones(1))
        weaker = weaker.model_copy(update={"props": (*weaker.props[:4], 0.0)})
        weaker.compute_stress(stress, np.array([[0.0, 0.0, 0.0, 1e-2]]), state, 1.0)
        reached.append(stress[0, 3])
    assert reached[0] == pytest.approx(2.0 * reached[1], rel=1e-12) and reached[1] > 1e3
    assert law.weakened(2.0).props[0] == law.props[0]
    parameters = {k: list(v) if isinstance(v, tuple) else v for k, v in law.model_dump(exclude_none=True).items()}
    scene = {
        "dimension": 2, "spacing": 0.1, "gravity": [0, -9.81], "materials": {"soil": {"model": "umat"} | parameters},
        "bodies": [{"name": "b", "material": "soil", "shape": {"type": "box", "lower": [0, 0], "upper": [1, 1]}}],
        "stages": [{"name": "safety", "type": "strength_reduction", "trial": 1.0, "damping": {"viscous": 20.0}}],
    }  # fmt: skip
    periporo.Simulation.from_scene(scene)
    del scene["materials"]["soil"]["strength_props"]
    with pytest.raises(periporo.InputError, match="give strength_props"):
        periporo.Simulation.from_scene(scene)


@needs_c
def test_what_does_not_suit_is_refused(compiled, tmp_path):
    cases = (
        ({"library": str(tmp_path / "none.so")}, "there is no library"),
        ({"symbol": "other"}, "has no subroutine other .looked for other_"),
        ({"props_count": 6}, "the law wants 6 props, not 5"),
        ({"initial_state_variables": [1.0, 2.0]}, "must be 1 numbers"),
        ({"bulk_modulus": 1e6}, "together"),
        ({"strength_props": [6]}, "name prop 6, but there are 5"),
        ({"tensors": [1], "strain_tensors": [1]}, "name state variable 1; each"),
        ({"props": [np.inf, MU, 0.1, 1.0, 0.0]}, "finite"),
    )
    for change, message in cases:
        with pytest.raises(ValidationError, match=message):
            soil(compiled, **change)
    with pytest.raises(ValidationError, match="cannot be loaded.*umat_utilities.c"):
        Umat(density=1.0, library=compiled("cc", SOURCES / "nosy.c"), props=[K, MU, 0, 1.0])
