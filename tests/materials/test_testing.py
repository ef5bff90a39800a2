"""The conformance kit: every installed law passes, and every breach is found and named."""

import numpy as np
import pytest

from periporo.core.points.material import OPENED, Material, StateField, StepRefused
from periporo.materials import registry, testing
from periporo.materials.arena import Arena
from periporo.materials.cam_clay import CamClay
from periporo.materials.drucker_prager import DruckerPrager
from periporo.materials.elastic import Elastic
from periporo.materials.norsand import NorSand
from periporo.materials.testing import check_material

LAWS = sorted(name for name in registry.available() if hasattr(registry.load(name), "example"))
VARIANTS = {
    "dry Arena": Arena(initial_saturation=0.0, T1=0.0, T2=0.0),
    "saturated Arena": Arena(initial_saturation=1.0, p0=1e6),
    "Arena with all parts": Arena(
        do_damage=True, do_variability=True, use_disaggregation_algorithm=True, weibull_reference_volume=1e-6,
        weibull_modulus={"STREN": 5.0}, report_plastic_strain=True, report_dissipation=True,
    ),
    "unsaturated": CamClay.example().for_unsaturated(),
    "rate-independent": CamClay.example().model_copy(update={"viscosity": 0.0, "report_dissipation": True}),
    "slow": CamClay.example().model_copy(update={"viscosity": 1e9}),
    "undrained": DruckerPrager.example().model_copy(update={"friction_angle": 0.0, "dilation_angle": 0.0}),
    "critical": DruckerPrager.example().model_copy(update={"largest_dilation": 0.01, "report_dissipation": True}),
    "liquefying": NorSand.example().model_copy(
        update={"initial_state_parameter": 0.1, "pressure_exponent": 1.0, "report_dissipation": True}
    ),
    "associated": DruckerPrager.example().model_copy(
        update={"dilation_angle": 35.0, "report_dissipation": True}
    ),
}


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", LAWS)
def test_every_installed_law_conforms(name, dimension):
    material = registry.load(name).example()
    assert isinstance(material, Material)
    report = check_material(material, dimension)
    assert (report.law, report.dimension) == (type(material).__name__, dimension)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", VARIANTS)
def test_variants_of_the_soils_conform(name, dimension):
    """Plastic laws lose energy in a closed cycle: the work is positive."""
    assert check_material(VARIANTS[name], dimension, seed=1).cycle_energy > 0.0


def test_all_built_in_laws_are_covered():
    laws = {"arena", "elastic", "cam_clay", "drucker_prager", "granular_mu_i", "hypoplastic_sand", "mohr_coulomb"}
    assert laws | {"herschel_bulkley", "norsand"} <= set(LAWS)


def test_elastic_cycle_returns_its_work():
    assert abs(check_material(Elastic.example()).cycle_energy) < 1e-9


class Sound:
    """A conforming law that the breaches below are made from: elastic, with a counter of strain as state."""

    density = 1700.0
    state_fields = (StateField("path_length", "1"), StateField("strain", "1", kind="tensor"))
    bulk, shear = 25e6, 15e6

    def initial_state(self, stress, ids, volume):
        return np.zeros((len(stress), 1 + stress.shape[1]))

    def compute_stress(self, stress, strain_increment, state, dt):
        stress += 2 * self.shear * strain_increment
        stress[:, :3] += (self.bulk - 2 / 3 * self.shear) * strain_increment[:, :3].sum(axis=1, keepdims=True)
        squares = strain_increment**2
        state[:, 0] += np.sqrt(squares.sum(axis=1) + squares[:, 3:].sum(axis=1))
        state[:, 1:] += strain_increment

    def elastic_moduli(self, stress, state):
        return np.full(len(stress), self.bulk), np.full(len(stress), self.shear)


def test_the_sound_law_conforms():
    for dimension in (2, 3):
        report = check_material(Sound(), dimension)
        assert abs(report.cycle_energy) < 1e-9 and report.stiffness == pytest.approx(1.0, rel=1e-6)


class NoDensity(Sound):
    density = 0.0


class ListOfFields(Sound):
    state_fields = [StateField("path_length", "1")]


class BadMerge(Sound):
    state_fields = (StateField("path_length", "1", merge="median"), Sound.state_fields[1])


class BadKind(Sound):
    state_fields = (StateField("path_length", "1", kind="spinor"), Sound.state_fields[1])


class SameName(Sound):
    state_fields = (StateField("strain", "1"), Sound.state_fields[1])


class NoMethod(Sound):
    elastic_moduli = None


class LogOfZero(Sound):
    state_fields = (StateField("path_length", "1", merge="log_mean"), Sound.state_fields[1])


class NarrowState(Sound):
    def initial_state(self, stress, ids, volume):
        return np.zeros((len(stress), 1))


class IntegerState(Sound):
    def initial_state(self, stress, ids, volume):
        return np.zeros((len(stress), 1 + stress.shape[1]), dtype=int)


class Returns(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        return stress


class Rebinds(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        stress = stress + 2 * self.shear * strain_increment


class NeedsRows(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        assert len(stress) > 0, "nothing to do"


class ChangesIncrement(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        strain_increment *= 2.0


class NegativeModulus(Sound):
    def elastic_moduli(self, stress, state):
        return np.full(len(stress), self.bulk), np.full(len(stress), -1.0)


class ScalarModulus(Sound):
    def elastic_moduli(self, stress, state):
        return self.bulk, self.shear


class SoftModuli(Sound):
    """A hundredth of the stiffness that it has."""

    def elastic_moduli(self, stress, state):
        return np.full(len(stress), self.bulk / 100), np.full(len(stress), self.shear / 100)


class SoftShear(Sound):
    def elastic_moduli(self, stress, state):
        return np.full(len(stress), self.bulk), np.full(len(stress), 0.8 * self.shear)


class StiffBulk(Sound):
    def elastic_moduli(self, stress, state):
        return np.full(len(stress), 100 * self.bulk), np.full(len(stress), self.shear)


class TangentModuli(Sound):
    """Twice as stiff in unloading, which the moduli do not tell."""

    def compute_stress(self, stress, strain_increment, state, dt):
        opens = strain_increment[:, :3].sum(axis=1) > 0.0
        super().compute_stress(stress, np.where(opens[:, None], 2.0, 1.0) * strain_increment, state, dt)


class RefusesZeros(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        if not stress.any(axis=1).all():
            raise FloatingPointError("no stress")
        super().compute_stress(stress, strain_increment, state, dt)


class NaNFromZeros(Sound):
    def elastic_moduli(self, stress, state):
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.bulk * (stress[:, 0] / stress[:, 0]), np.full(len(stress), self.shear)

    def initial_state(self, stress, ids, volume):
        stress[~stress.any(axis=1), :3] = -1.0
        return super().initial_state(stress, ids, volume)


class ForeignOrder(Sound):
    """Takes the strain as xx yy zz xy xz yz."""

    def compute_stress(self, stress, strain_increment, state, dt):
        order = [0, 1, 2, 3, 5, 4][: stress.shape[1]]
        super().compute_stress(stress, strain_increment[:, order], state, dt)


class Cautious(Sound):
    """Refuses strains over 1e-3, and leaves the arrays spoiled."""

    bears = 1e-3

    def refused(self, stress, strain_increment):
        return np.flatnonzero(np.abs(strain_increment).max(axis=1, initial=0.0) > self.bears)

    def compute_stress(self, stress, strain_increment, state, dt):
        over = self.refused(stress, strain_increment)
        super().compute_stress(stress, strain_increment, state, dt)
        if len(over):
            stress[:] = state[:] = np.nan
            raise StepRefused(over)


class RefusesAll(Cautious):
    bears = 1e-12


class RefusesStill(Cautious):
    def refused(self, stress, strain_increment):
        return np.flatnonzero((np.abs(strain_increment) < 1e-12).all(axis=1))


class RefusesOthers(Cautious):
    def refused(self, stress, strain_increment):
        return super().refused(stress, strain_increment) + 1000


class Drifts(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        stress[:, :3] -= 1.0


class IgnoresTime(Sound):
    """Relaxes by the same share however short the step is."""

    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        if np.isfinite(dt):
            stress *= 0.9


class Anisotropic(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        stress[:, 0] += 1e3 * strain_increment[:, 0]


class EngineeringShear(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        stress[:, 3:] -= self.shear * strain_increment[:, 3:]


class UndeclaredTensor(Sound):
    """Keeps one component of strain as a scalar."""

    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        state[:, 0] += strain_increment[:, 0]


class MixesRows(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        stress += 1e-6 * self.bulk * np.abs(strain_increment).max(initial=0.0)


class RandomStart(Sound):
    def initial_state(self, stress, ids, volume):
        state = super().initial_state(stress, ids, volume)
        state[:, 0] = np.random.default_rng().normal(size=len(stress))
        return state


class NaNInTension(Sound):
    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        with np.errstate(invalid="ignore"):
            state[:, 0] += 0.0 * np.sqrt(-stress[:, :3].sum(axis=1))


class Loose(Sound):
    """Of a third party, with an apex at 1 kPa: what it cannot bear it lets go."""

    state_fields = (StateField("number", "1"), OPENED)

    def initial_state(self, stress, ids, volume):
        return np.zeros((len(stress), 2))

    def compute_stress(self, stress, strain_increment, state, dt):
        stress += 2 * self.shear * strain_increment
        stress[:, :3] += (self.bulk - 2 / 3 * self.shear) * strain_increment[:, :3].sum(axis=1, keepdims=True)
        beyond = np.maximum(stress[:, :3].mean(axis=1) - 1e3, 0.0)
        stress[:, :3] -= beyond[:, None]
        self.let_go(beyond / self.bulk, state)

    def let_go(self, strain, state):
        """Nothing to do where the program knows the limit."""

    def tension_limit(self, stress, state):
        return np.full(len(stress), 1e3)


class OpensItself(Loose):
    """Knows by itself what it lets go."""

    tension_limit = None

    def let_go(self, strain, state):
        state[:, 1] += strain


class KeepsItsGaps(Loose):
    """Has an apex, and says nothing of it."""

    tension_limit = None
    state_fields = (StateField("number", "1"), StateField("another", "1"))


class LimitAlone(Loose):
    state_fields = KeepsItsGaps.state_fields


class LimitOfAll(Loose):
    def tension_limit(self, stress, state):
        return 1e3


class WrongLimit(Loose):
    def tension_limit(self, stress, state):
        return np.full(len(stress), 2e3)


class OpensTwice(Loose):
    """Counts what the program counts."""

    def let_go(self, strain, state):
        state[:, 1] += strain


class OpensByHalf(OpensItself):
    def let_go(self, strain, state):
        state[:, 1] += 0.5 * strain


class Derives(Sound):
    """Tells half of its path length, too."""

    derived_fields = (StateField("half", "1"),)
    default_output = ("half", "path_length")

    def derived_state(self, stress, state):
        return {"half": 0.5 * state[:, 0]}


class DerivesOther(Derives):
    def derived_state(self, stress, state):
        return {"third": state[:, 0] / 3}


class DerivesInPlace(Derives):
    def derived_state(self, stress, state):
        state += 1.0
        return {"half": state[:, 0]}


class ShowsUnknown(Derives):
    default_output = ("quarter",)


class Loses(Sound):
    """Friction: a share of the stiffness times the strain's length is lost."""

    def compute_stress(self, stress, strain_increment, state, dt):
        super().compute_stress(stress, strain_increment, state, dt)
        norm = np.sqrt(np.sum(strain_increment**2, axis=1) + np.sum(strain_increment[:, 3:] ** 2, axis=1))
        stress[:, :3] -= 0.01 * self.bulk * norm[:, None]


class Dissipates(Loses):
    conservative = True


class LosesWherePressed(Loses):
    """The same where there is stress; without, next to nothing is as stiff as anything."""

    def initial_state(self, stress, ids, volume):
        state = super().initial_state(stress, ids, volume)
        state[:, 0] = 1.0 if stress.any() else 1e-9
        return state

    def compute_stress(self, stress, strain_increment, state, dt):
        before, share = stress.copy(), state[:, 0].copy()
        super().compute_stress(stress, strain_increment, state, dt)
        stress[:] = before + share[:, None] * (stress - before)
        state[:, 0] = share

    def elastic_moduli(self, stress, state):
        share = np.maximum(state[:, 0], 1e-9)
        return self.bulk * share, self.shear * share


@pytest.mark.parametrize(
    "law, error, hint",
    [
        (NoDensity, testing.DeclarationError, "positive number in kg/m"),
        (ListOfFields, testing.DeclarationError, "must be a tuple"),
        (BadMerge, testing.DeclarationError, "'mean' or 'log_mean'"),
        (BadKind, testing.DeclarationError, "'scalar', 'tensor', 'vector' or 'matrix'"),
        (SameName, testing.DeclarationError, "that no other has"),
        (NoMethod, testing.DeclarationError, "no method `elastic_moduli`"),
        (LogOfZero, testing.DeclarationError, "starts at 0"),
        (NarrowState, testing.ShapeError, "must give a float64 array"),
        (IntegerState, testing.ShapeError, "must give a float64 array"),
        (Returns, testing.ShapeError, "return None"),
        (Rebinds, testing.ShapeError, r"assign to stress\[:\]"),
        (NeedsRows, testing.ShapeError, "fails for zero rows"),
        (ChangesIncrement, testing.ShapeError, "work on a copy"),
        (NegativeModulus, testing.ModuliError, "shear modulus"),
        (ScalarModulus, testing.ModuliError, "bulk modulus"),
        (SoftModuli, testing.ModuliError, "100 times as stiffly as its bulk modulus says"),
        (SoftShear, testing.ModuliError, "1.25 times as stiffly as its shear modulus says"),
        (StiffBulk, testing.ModuliError, "more than 0.01 of its bulk modulus"),
        (TangentModuli, testing.ModuliError, "2 times as stiffly as its bulk modulus says"),
        (RefusesZeros, testing.ShapeError, "are all 0"),
        (NaNFromZeros, testing.NonFiniteError, "are all 0"),
        (RefusesAll, testing.RefusalError, "halved 6 times"),
        (RefusesStill, testing.RefusalError, "has no strain increment"),
        (RefusesOthers, testing.RefusalError, "give their indices"),
        (Drifts, testing.ZeroIncrementError, "dt = inf"),
        (IgnoresTime, testing.ZeroIncrementError, "dt = 1e-30"),
        (Anisotropic, testing.FrameError, "in turned axes"),
        (EngineeringShear, testing.FrameError, "factor 2"),
        (UndeclaredTensor, testing.FrameError, "state column 0"),
        (MixesRows, testing.SplitError, "alone"),
        (RandomStart, testing.SplitError, "seed random numbers by ids"),
        (NaNInTension, testing.NonFiniteError, "random walk"),
        (DerivesOther, testing.ShapeError, "`derived_fields` lists {'half': "),
        (DerivesInPlace, testing.ShapeError, "only looks at them"),
        (ShowsUnknown, testing.DeclarationError, "neither state nor derived"),
        (KeepsItsGaps, testing.OpeningError, "list periporo.materials.OPENED"),
        (LimitAlone, testing.OpeningError, "does not list OPENED"),
        (LimitOfAll, testing.ShapeError, "a number for each row"),
        (WrongLimit, testing.OpeningError, "let `tension_limit` tell the largest mean stress"),
        (OpensTwice, testing.OpeningError, "leave the column alone, or take `tension_limit` away"),
        (OpensByHalf, testing.OpeningError, "by all that it expands"),
        (Dissipates, testing.CycleEnergyError, "drop `conservative`"),
    ],
)
@pytest.mark.parametrize("dimension", [2, 3])
def test_breaches_are_named(law, error, hint, dimension):
    with pytest.raises(error, match=hint) as caught:
        check_material(law(), dimension)
    assert isinstance(caught.value, AssertionError) and law.__name__ in str(caught.value)


@pytest.mark.parametrize("share", [0.01, 0.5, 100.0])
def test_wrong_moduli_are_not_taken_for_a_wrong_limit_of_tension(share):
    """The clause about openings measures by the moduli, so it comes after theirs."""

    class Scaled(DruckerPrager):
        def elastic_moduli(self, stress, state):
            bulk, shear = super().elastic_moduli(stress, state)
            return share * bulk, share * shear

    with pytest.raises(testing.ModuliError):
        check_material(Scaled(**DruckerPrager.example().model_dump()), 2)


def test_the_order_of_components_is_seen_in_space():
    """Where yz and xz stand is told by a shear in three dimensions alone; in the plane neither exists."""
    check_material(ForeignOrder(), 2)
    with pytest.raises(testing.FrameError, match="strain in yz makes stress in xz"):
        check_material(ForeignOrder(), 3)


def test_a_cycle_is_measured_by_the_moduli_of_its_rows():
    """Not by those without stress, which may be next to nothing."""
    loose = check_material(LosesWherePressed()).cycle_energy
    assert loose == pytest.approx(check_material(Loses()).cycle_energy, rel=1e-9) and 1e-3 < abs(loose) < 1e3


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("law", [Loose, OpensItself, Derives])
def test_sound_variants_conform(law, dimension):
    """An apex that the program or the law opens; derived state."""
    assert check_material(law(), dimension).stiffness == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_law_may_refuse_what_is_too_much(dimension):
    assert abs(check_material(Cautious(), dimension).cycle_energy) < 1e-9
