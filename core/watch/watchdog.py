"""Watches a run: a state that cannot be right is taken back and tried again with half the step, or reported.

Every few steps all ranks look for NaN, for points faster than the waves of their material, for bonds whose strain jumps
within a step, and for energy that comes from nowhere, or from what can only store or lose it; a step that a law refuses
is known in the next one. Every few hundred steps the state is kept in memory. After a failure the run goes on from
there with half the time step, and looks at every step, until the next state is kept; if it fails again the step is
halved again, at most `MOST_RETRIES` times. All of this depends on the state alone, hence not on the number of ranks.
"""

from dataclasses import replace

import numpy as np
from mpi4py import MPI

from periporo.core.numerics.jit import kernel
from periporo.core.numerics.tensors import square_lengths
from periporo.core.points.forces import INTEGRATION, WORK
from periporo.core.ranks.reductions import exact_sum, maximum
from periporo.core.watch.diagnosis import Fault, find_fault, report
from periporo.core.watch.interrupt import CHECK_INTERVAL
from periporo.core.watch.state import capture, install

SNAPSHOT_INTERVAL = 500  # steps between states kept in memory
MOST_RETRIES = 3  # at half, quarter and an eighth of the step
MOST_FAILURES = 20  # of a run: one that always needs help is not to be trusted
STRAIN_JUMP = 1.0  # strain of a bond within one step
REGULAR = 0.5  # integrity of a point from which on its speed and strain count
_COMPANY = 0.15  # weight of a point's neighbours over that of any other's, from which on its speed counts
_SUSPECT = 0.25  # speed over wave speed, as it was when the state was kept, from which on neighbours are compared
_WARM_UP = 100  # steps of a motion before its energy is judged: a start from rest has hardly done any work
_TURNED_OVER = (
    "kinetic_energy", "internal_energy", "external_work", "contact_energy", "friction_dissipation",
    "damping_dissipation", "prescribed_work",
)  # fmt: skip


_GIVERS = {"contact_energy": "contact", "friction_dissipation": "friction", "damping_dissipation": "damping"}
_STORES = ("kinetic_energy", "internal_energy", *_GIVERS)
_SOURCES = ("external_work", "prescribed_work", "obstacle_work")
_NOISE = 1e-16  # energy that contacts of bodies at rest may seem to give, over that of the bodies at their wave speeds


class WatchdogError(RuntimeError):
    """The run went wrong and could not be repaired; raised on all ranks alike."""


class Watchdog:
    """Checks a simulation every `CHECK_INTERVAL` steps.

    energy_tolerance: largest energy error over the work done. materials: their names. diagnostics: path of the file
    that describes a failure. rewind: function of a step number that drops the results recorded after it. message:
    function of a text. `retries` counts the repairs.
    """

    def __init__(self, energy_tolerance, materials, diagnostics, *, rewind=lambda step: None, message=print):
        self.energy_tolerance = energy_tolerance
        self.materials = list(materials)
        self.diagnostics = diagnostics
        self.rewind = rewind
        self.message = message
        self.retries = 0
        self._failures = 0  # since the last sound state was kept
        self._last_kind = ""
        self._kept = None
        self._stage = None
        self._fastest = np.empty(0)  # wave speed of each material, m/s
        self._noise = 0.0  # J

    def start_stage(self, sim, stage) -> None:
        """Keep the state in which a stage begins or goes on."""
        self._stage = stage
        self._keep(sim)

    def check(self, sim) -> None:
        """After a step: keep the state, or take it back. Raises WatchdogError if that was tried often enough."""
        if sim.step_number % CHECK_INTERVAL == 0 or self._failures > 0:
            sim.confirm()
            self._look(sim)

    def _look(self, sim):
        careful = self._failures > 0
        fault = self._fault(sim)
        _forget_peaks(sim)
        if fault is not None:
            self._take_back(sim, fault)
        elif sim.step_number % SNAPSHOT_INTERVAL == 0:
            if careful:
                self._relent(sim)
            self._keep(sim)

    def conclude(self, sim) -> bool:
        """At the end of a stage: whether its last state is sound; else it is taken back, and the stage goes on."""
        before = self.retries
        if sim.step_number % CHECK_INTERVAL != 0 and self._failures == 0:  # else this has just been done
            self._look(sim)
        return self.retries == before

    def refused(self, sim, refusal) -> None:
        """Take back a step that is refused. Raises WatchdogError if that was tried often enough."""
        offends = 2.0 * np.isin(sim.particles.id[: sim.particles.owned], refusal.points)
        self._take_back(sim, replace(self._describe(sim, refusal.kind, offends), reason=refusal.reason))

    def _relent(self, sim):
        """Back to the step before the failure; not after an energy error, which would only come back."""
        if self._last_kind not in ("energy", "gain"):
            self._scale_time_step(sim, 2.0**self._failures)
        self._failures = 0
        part = "the full" if sim.time_step.reduction == 1.0 else f"{sim.time_step.reduction:g} of the"
        self.message(f"step {sim.step_number}: sound again, going on with {part} time step")

    def _keep(self, sim):
        _forget_peaks(sim)
        self._fastest = wave_speeds(sim)
        speed = np.where(np.isfinite(self._fastest), self._fastest, 0.0)[sim.particles.material[: sim.particles.owned]]
        self._noise = _NOISE * float(exact_sum(sim.comm, sim.particles.mass * speed**2)[0])
        self._kept = capture(sim)

    def _take_back(self, sim, fault: Fault):
        if self._failures == MOST_RETRIES or self.retries == MOST_FAILURES:
            report(sim, fault, self.diagnostics)
            raise WatchdogError(f"{fault}\n{self.retries} repairs were tried; details in {self.diagnostics}")
        self._failures += 1
        self.retries += 1
        self._last_kind = fault.kind
        install(sim, self._kept)
        self.rewind(sim.step_number)
        self._scale_time_step(sim, 0.5**self._failures)
        self.message(f"{fault}\nback to step {sim.step_number} with {sim.time_step.reduction:g} of the time step")

    def _scale_time_step(self, sim, factor):
        sim.time_step.reduction *= factor
        sim.dt *= factor

    def _fault(self, sim) -> Fault | None:
        """What is wrong with the present state; the same on all ranks."""
        nan, speed, strain = survey(sim, self._fastest)
        if nan:
            return self._describe(sim, "nan", nan_points(sim))
        if speed > _SUSPECT:
            excess = speed_ratios(sim, wave_speeds(sim))
            if maximum(sim.comm, float(excess.max(initial=0.0))) > 1.0:
                return self._describe(sim, "speed", excess)
        if strain > STRAIN_JUMP:
            excess = strain_jumps(sim) / STRAIN_JUMP
            if maximum(sim.comm, float(excess.max(initial=0.0))) > 1.0:
                return self._describe(sim, "strain", excess)
        if sim.rate_independent:
            return None
        rough = sim.ledger.rough_entries()
        if max(self._energy_error(sim, rough), self._gain(sim, rough)[0]) <= 0.5 * self.energy_tolerance:
            return None
        entries = sim.ledger.entries()  # the same for any number of ranks
        error = self._energy_error(sim, entries)
        if not error <= self.energy_tolerance:
            return self._blame(sim, "energy", np.abs(sim.particles.work[:, INTEGRATION]), error)
        gain, channel = self._gain(sim, entries)
        if gain > self.energy_tolerance:
            given = np.maximum(sim.particles.work[:, WORK.index(channel)], 0.0)
            return replace(self._blame(sim, "gain", given, gain), reason=channel)
        return None

    def _blame(self, sim, kind, share, size):
        return self._describe(sim, kind, share / maximum(sim.comm, float(share.max(initial=0.0))), size)

    def _warms_up(self, sim):
        return sim.step_number < self._stage.first_step + _WARM_UP

    def _energy_error(self, sim, entries):
        """Energy that nothing explains over the energy that was turned over, since the stage began; NaN stays."""
        if self._warms_up(sim):
            return 0.0
        error = abs(entries["energy_residual"] - self._stage.initial_energies["energy_residual"])
        if error == 0.0:
            return 0.0
        turned_over = _turned_over(entries)
        return error / turned_over if turned_over != 0.0 else np.inf

    def _gain(self, sim, entries):
        """Energy that a channel gave and had not taken, over the energy at hand; and the channel.

        What it gave while equilibrium was looked for, by moves that are no motion, does not count, and then it may hold
        what was not booked; nor, of the integrator's term, what velocity Verlet only lends while forces act.
        """
        before = self._stage.initial_energies
        judged = (name for name in _GIVERS if before[name] >= 0.0 or not self._warms_up(sim))
        given = {_GIVERS[name]: min(before[name], 0.0) - entries[name] for name in judged}
        given["integration"] = entries["energy_residual"] - before["energy_residual"]
        if given["integration"] > 0.5 * self.energy_tolerance * _at_hand(sim, entries):
            given["integration"] -= borrowed(sim)
        channel = max(given, key=given.__getitem__)
        return (given[channel] / _at_hand(sim, entries) if given[channel] > self._noise else 0.0), channel

    def _describe(self, sim, kind, excess, size=None):
        return find_fault(sim, kind, excess, self.materials, self._kept, size)


def _turned_over(entries):
    return sum(abs(entries[name]) for name in _TURNED_OVER)


def _at_hand(sim, entries):
    """Energy that was put in, or is in stores and losses by now, whichever is more."""
    put_in = sim.ledger.initial_kinetic + sum(max(entries.get(name, 0.0), 0.0) for name in _SOURCES)
    return max(put_in, sum(max(entries[name], 0.0) for name in _STORES))


def borrowed(sim) -> float:
    """What velocity Verlet lends to the motion while the present forces act, m (a dt)^2/8 of all points, J; collective.

    The integrator's terms of alike steps add up to its change, so that it is given back when the forces end.
    """
    p, n = sim.particles, sim.particles.awake
    kick = p.velocity[:n] - p.previous_velocity[:n]  # a dt / 2
    return float(exact_sum(sim.comm, 0.5 * p.mass[:n] * square_lengths(kick))[0])


def _forget_peaks(sim):
    for block in sim.bonds.blocks:
        block.forget_peak()


def wave_speeds(sim) -> np.ndarray:
    """Largest speed of compression waves in each material at present, (materials,) m/s."""
    speeds = np.zeros(len(sim.materials))
    for block in sim.bonds.blocks:
        speeds[block.index] = np.sqrt(block.stiffest(block.elastic_moduli()) / block.material.density)
    sim.comm.Allreduce(MPI.IN_PLACE, speeds, MPI.MAX)
    speeds[speeds == 0.0] = np.inf  # without bonds there are no waves
    return speeds


def survey(sim, fastest) -> np.ndarray:
    """Over all ranks: 1 if a point is NaN, largest speed over wave speed, largest strain of a bond in a step, (3,).

    The strain is that of all steps since the last look.
    """
    p = sim.particles
    seen = np.zeros(3)
    _survey_points(p.owned, p.position, p.velocity, p.material, 1.0 / fastest**2, seen, p.dim)
    for block in sim.bonds.blocks:
        seen[2] = max(seen[2], block.peak[0])
    seen[1:] = np.sqrt(seen[1:])
    sim.comm.Allreduce(MPI.IN_PLACE, seen, MPI.MAX)
    return seen


def nan_points(sim) -> np.ndarray:
    """Per owned point: 2 if its position or velocity is NaN or infinite, else 0."""
    n = sim.particles.owned
    finite = np.isfinite(sim.particles.position[:n]) & np.isfinite(sim.particles.velocity[:n])
    return np.where(finite.all(axis=1), 0.0, 2.0)


def speed_ratios(sim, fastest) -> np.ndarray:
    """Per owned point: its speed relative to the mean of its regular neighbours over the wave speed of its material.

    Zero for a point without regular company, and for one that passes by with little of it; collective.
    """
    p, n, pairs = sim.particles, sim.particles.owned, sim.bonds.pairs
    sim.halo.update(p, "velocity")
    sums = np.zeros((n, 1 + p.dimension))
    _add_differences(n, pairs.first, pairs.second, pairs.weight, p.share, p.volume, p.velocity, REGULAR, sums, p.dim)
    most = maximum(sim.comm, float(sums[:, 0].max(initial=0.0)))
    weight = np.where(sums[:, 0] > _COMPANY * most, sums[:, 0], np.inf)
    relative = np.sqrt(square_lengths(sums[:, 1:])) / weight
    return relative / fastest[p.material[:n]]


def strain_jumps(sim) -> np.ndarray:
    """Per owned point: the strain of its bonds in the last step, and that of the largest since the last look.

    Bonds of points without regular company do not count.
    """
    p = sim.particles
    jump, regular = np.zeros(p.total), p.share[:, 1] >= REGULAR
    for block in sim.bonds.blocks:
        index, first, second, _ = sim.bonds.layout.ends(block, sim.bonds.pairs)
        first, second = first[index], second[index]
        counts = block.active & regular[first] & regular[second]
        size = np.sqrt((block.strain_increment**2).sum(axis=1)) * counts
        np.maximum.at(jump, first, size)
        np.maximum.at(jump, second, size)
        ends = np.isin(p.id, sim.bonds.peak_ends(block))
        if regular[ends].all():
            jump[ends] = np.maximum(jump[ends], np.sqrt(block.peak[0]))
    return jump[: p.owned]


@kernel
def _survey_points(owned, position, velocity, material, inverse_square, seen, dim):
    nan, largest = 0.0, 0.0
    for i in range(owned):
        square, total = 0.0, 0.0
        for a in range(len(dim)):
            square += velocity[i, a] ** 2
            total += position[i, a]
        if not (np.isfinite(square) and np.isfinite(total)):
            nan = 1.0
        largest = max(largest, square * inverse_square[material[i]])
    seen[0], seen[1] = nan, largest


@kernel
def _add_differences(owned, first, second, weight, share, volume, velocity, regular, sums, dim):
    """Add to `sums` (owned, 1 + d) of both ends of a pair w V, and w V times its velocity less the other's."""
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        if not (weight[b] > 0.0 and share[i, 1] >= regular and share[j, 1] >= regular):
            continue
        for here, there in ((i, j), (j, i)):
            if here < owned:
                w = weight[b] * volume[there]
                sums[here, 0] += w
                for a in range(len(dim)):
                    sums[here, 1 + a] += w * (velocity[here, a] - velocity[there, a])
