"""Flow in the increments of a quasi-static stage: water and the volume of its pores by the fixed-stress split.

While water flows in an increment the pores of a point have the volume ratio

    J = J_0 + C t/T + c S_0 (p - p_0),

with the compliance c of elastic soil under a constant total stress, and a part C that grows evenly with the time t of
the increment, of T s. After it the soil finds its equilibrium under the pressures; C takes what the volumes found
differ from those assumed, by Aitken's relaxation (Küttler & Wall 2008), until both agree. What they still differ by
the next increment makes good, for it begins with the volumes that were assumed, and the water that flowed: none is
lost. The rate of the last increment is the first guess; free water loads all that is below its level.

What counts is the mean of a difference over the neighbours. Pressures that alternate from point to point move no point,
so no volume could answer to them; they have the compliance c, and die out by flow.
"""

import math

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Field
from periporo.core.ranks.reductions import exact_sum, maximum
from periporo.core.water.bishop import fill_factors
from periporo.core.water.content import follow_volume
from periporo.core.water.retention import saturation_of
from periporo.core.water.stages import EULER, stages_for

# at the start of the increment: p, J as assumed and as found, w; c S_0; C, what it is wrong by, and what it makes good;
# rates of p, and of J beyond c S_0 p, in the increment before; and what had been exchanged at its start
PRESSURE, DILATION, FOUND, WATER = range(4)
COMPLIANCE, CORRECTION, WRONG, CARRIED, PRESSURE_RATE, DILATION_RATE = range(4, 10)
EXCHANGED = slice(10, None)
_SHORTEST = 1.0  # longest explicit steps of the flow
_MOST_STAGES = 199  # of the flow at once
_FASTER, _MUCH_FASTER = 1.2, 8.0  # what the flow may become in an increment; else it is done again, or is too long
_MOST_TRIALS = 8
_RELAXED = (0.2, 1.9)  # bounds of Aitken's factor: more would feed what answers at once
_OWN = 3.0  # weight of a point in the mean over its neighbours, over the largest of them
_CONVERGED = 1e-15  # of the volume, in the equation for the pressure
_MOST_ITERATIONS = 200
_REMEMBERED = ("relaxation", "largest", "length", "running")


class Increments:
    """The increments of a `FlowingWater`; points keep a row of what they are reckoned from."""

    def __init__(self, water):
        self.water = water
        self.running = False
        self.relaxation = 0.0  # Aitken's factor, 0 before the first correction of an increment
        self.largest = 0.0  # Pa, pressure since the stage began
        self.length = 0.0  # s
        self._sim = None

    def attach(self, sim) -> None:
        """Declare the point field."""
        self._sim = sim
        columns = EXCHANGED.start + self.water.sums - 1
        sim.particles.add_field(Field("increment", columns, "Pa, 1, m^3, 1/Pa, 1/s, J", sent=False))
        sim.particles.add_field(Field("averaged", None, "1", migrates=False))

    def start(self) -> None:
        """Begin a stage."""
        self.running, self.largest = True, 0.0
        self._sim.particles.increment[:] = 0.0
        self._take_down(afresh=True)

    def stop(self) -> None:
        """End the stage: what volumes and water still differ by comes in or goes."""
        p = self._sim.particles
        held = p.water_content.copy()
        self.water.fill_content(p, p.water_content)
        gained = p.water_content - held
        self.water.note_exchange(p, gained)
        self.water.exchange(p, p.water_content)
        self.running = False

    def follow(self, p, dt: float) -> None:
        """Volume and saturation after a step of `dt` s towards equilibrium; pressure and water stay."""
        follow_volume(p, self._sim.scheme.seen_gradient(p), dt)
        self.water.fill_content(p, np.empty(p.owned))

    def flow(self, length: float) -> float:
        """Let water flow for `length` s from the start of the increment, in pores that give way as assumed.

        Returns by how much pressures may err by then, over the largest pressure (root mean square), and infinity where
        it is too long; collective.
        """
        p, row = self._sim.particles, self._sim.particles.increment
        if length != self.length:
            row[:, CORRECTION] = row[:, CARRIED] + row[:, DILATION_RATE] * length
            row[:, CORRECTION] -= row[:, COMPLIANCE] * self._loaded(p, length)
            self.length, self.relaxation = length, 0.0
        found, rate = p.pore_dilation.copy(), 0.0
        for _ in range(_MOST_TRIALS):
            p.water_content[:] = row[:, WATER]
            p.exchanged_water[:, 1:] = row[:, EXCHANGED]
            p.pore_pressure[:] = row[:, PRESSURE]
            self._fill_pressure(p, 0.0)
            net = self.water.network(p)
            start = self.water.fastest(p, net, row[:, COMPLIANCE])
            rate = max(rate, start)
            self._transport(p, net, rate)
            end = self.water.fastest(p, self.water.again(p, net), row[:, COMPLIANCE])
            if not end > _FASTER * rate or length == 0.0:
                break
            if not end < _MUCH_FASTER * rate:  # pores have filled: the stages were too few to be stable
                p.pore_pressure[:], p.pore_dilation[:] = row[:, PRESSURE], found
                return math.inf
            rate = end
        p.pore_dilation[:] = found
        self.water.exchange(p, p.water_content)
        self.water.update(p, self._sim.bonds, 0.0)
        return self._error(p)

    def shortest_time(self) -> float:
        """Length of an increment, s, in which water flows about as far as the next point; collective."""
        p = self._sim.particles
        return _SHORTEST / self.water.fastest(p, self.water.network(p), p.increment[:, COMPLIANCE])

    def disagreement(self) -> float:
        """What the volumes found differ from those assumed by, as pressures over the largest (root mean square)."""
        p, row = self._sim.particles, self._sim.particles.increment
        wrong = self._wrong(p) / row[:, COMPLIANCE]
        return self._relative(p, wrong)

    def correct(self, evenly: bool = False) -> None:
        """Correct the volumes that are assumed by what they were wrong by, `evenly`, or by Aitken's factor."""
        p, row, comm = self._sim.particles, self._sim.particles.increment, self._sim.comm
        wrong = self._wrong(p)
        if self.relaxation == 0.0 or evenly:
            self.relaxation = 1.0
        else:
            change = wrong - row[:, WRONG]
            along, square = exact_sum(comm, np.stack([row[:, WRONG] * change, change * change], axis=1)).tolist()
            factor = -self.relaxation * along / square if square > 0.0 else 1.0
            self.relaxation = min(max(factor, _RELAXED[0]), _RELAXED[1])
        row[:, WRONG] = wrong
        row[:, CORRECTION] += self.relaxation * wrong

    def accept(self) -> float:
        """Flow and equilibrium agree: the next increment begins here. Returns what `flow` does."""
        p, row, error = self._sim.particles, self._sim.particles.increment, self._error(self._sim.particles)
        self.largest = self._scale(p)
        if self.length > 0.0:
            row[:, PRESSURE_RATE] = (p.pore_pressure - row[:, PRESSURE]) / self.length
            change = p.pore_pressure - row[:, PRESSURE] - self._loaded(p, self.length)
            yielded = row[:, COMPLIANCE] * change
            row[:, DILATION_RATE] = self._mean(p, p.pore_dilation - row[:, FOUND] - yielded) / self.length
        self._take_down()
        return error

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {name: getattr(self, name) for name in _REMEMBERED}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        for name in _REMEMBERED:
            setattr(self, name, memory[name])

    def _take_down(self, afresh: bool = False) -> None:
        """Let the next increment begin with what is now."""
        p, row = self._sim.particles, self._sim.particles.increment
        self.water.look_around(p)
        row[:, CARRIED] = 0.0 if afresh else self._wrong(p)
        row[:, DILATION] = p.pore_dilation if afresh else self._assumed(p)
        row[:, FOUND] = p.pore_dilation
        row[:, PRESSURE], row[:, WATER] = p.pore_pressure, p.water_content
        row[:, EXCHANGED] = p.exchanged_water[:, 1:]
        for block in self._sim.bonds.blocks:
            bulk, shear = block.elastic_moduli()
            row[block.first, COMPLIANCE] = 0.5 / bulk + 0.5 / (bulk + 4.0 / 3.0 * shear)
        factor = np.empty(p.owned)
        fill_factors(self.water.pores.factors, p.material, p.pore_pressure, p.saturation, factor)
        row[:, COMPLIANCE] *= factor * p.pore_dilation
        self.length = -1.0  # s, none yet

    def _loaded(self, p, length):
        """By how much the pressure (owned,) Pa of free water rises in `length` s at the places of the points."""
        free, time = self.water.free, self._sim.time
        return np.zeros(p.owned) if free is None else free.pressure(p, time + length) - free.pressure(p, time)

    def _transport(self, p, net, rate):
        """Let water flow through `net`, whose fastest `rate` is given, in as many parts as it takes."""
        courant = 0.5 * self.length * rate
        most = EULER * (_MOST_STAGES**2 + _MOST_STAGES - 2) / 4.0
        parts = max(1, math.ceil(courant / most))
        part, begin = self.length / parts, self._sim.time
        stages = stages_for(courant / parts)
        for number in range(parts):
            gone = number * part
            if number:
                self.water.describe(p)
            self.water.transport(
                p, net, begin + gone, part, stages, lambda more, gone=gone: self._fill_pressure(p, gone + more)
            )  # fmt: skip

    def _fill_pressure(self, p, gone):
        water = self.water
        _fill_pressure(
            p.owned, p.material, water.pores.porosity, p.volume, water.pores.bulk_modulus, water.curves,
            gone / self.length if self.length > 0.0 else 1.0, p.increment, p.water_content, p.pore_dilation,
            p.saturation, p.pore_pressure,
        )  # fmt: skip

    def _assumed(self, p):
        """Volume ratios (owned,) at the end of the increment that were assumed."""
        row = p.increment
        return row[:, DILATION] + row[:, CORRECTION] + row[:, COMPLIANCE] * (p.pore_pressure - row[:, PRESSURE])

    def _wrong(self, p):
        """Volume ratios (owned,) that were found, less those that were assumed, as means; collective."""
        return self._mean(p, p.pore_dilation - self._assumed(p))

    def _mean(self, p, values):
        """Means (owned,) of `values` over the neighbours and the point itself; collective."""
        n, pairs = p.owned, self._sim.bonds.pairs
        p.averaged[:n] = values
        self._sim.halo.update(p, "averaged")
        sums = np.zeros((p.total, 3))
        _sum_neighbours(pairs.first, pairs.second, pairs.weight, p.volume, p.averaged, sums)
        own = _OWN * sums[:n, 2] * p.volume[:n]
        total = own + sums[:n, 0]
        return (own * values + sums[:n, 1]) / np.where(total > 0.0, total, 1.0)

    def _error(self, p):
        row = p.increment
        if self.length == 0.0:
            return 0.0
        changed = p.pore_pressure - row[:, PRESSURE] - self.length * row[:, PRESSURE_RATE]
        return 0.5 * self._relative(p, changed)

    def _scale(self, p) -> float:
        """Largest pressure so far, Pa; collective."""
        row = p.increment
        now = float(max(np.abs(p.pore_pressure).max(initial=0.0), np.abs(row[:, PRESSURE]).max(initial=0.0)))
        return max(self.largest, maximum(self._sim.comm, now))

    def _relative(self, p, values) -> float:
        """Root mean square of `values` (owned,) Pa over the largest pressure; collective."""
        rows = np.stack([values * values, np.ones(len(values))], axis=1)
        square, count = exact_sum(self._sim.comm, rows).tolist()
        scale = self._scale(p)
        return math.sqrt(square / count) / scale if scale > 0.0 else (math.inf if square > 0.0 else 0.0)


@kernel
def _fill_pressure(
    owned, material, initial_porosity, volume, bulk, curves, part, row, content, dilation, saturation, pressure,
):  # fmt: skip
    """p, J and S of the owned points that hold `content` m^3, when a `part` of the increment is over.

    By Newton's method within a bracket: what pores hold grows with the pressure.
    """
    for i in range(owned):
        m = material[i]
        solid, filled = 1.0 - initial_porosity[m], content[i] / volume[i]
        low, high = -bulk, np.inf
        p = pressure[i]
        for _ in range(_MOST_ITERATIONS):
            ratio = row[i, DILATION] + part * row[i, CORRECTION] + row[i, COMPLIANCE] * (p - row[i, PRESSURE])
            pores = max(ratio - solid, 0.0)
            phi = pores / ratio
            s, slope = saturation_of(curves, m, -p, phi, ratio)
            squeezed = 1.0 + p / bulk
            excess = pores * s * squeezed - filled
            if abs(excess) <= _CONVERGED * ratio or np.isnan(excess):
                break
            if excess > 0.0:
                high = p
            else:
                low = p
            rate = pores * (s / bulk - slope * squeezed) + (row[i, COMPLIANCE] * s * squeezed if pores > 0.0 else 0.0)
            new = p - excess / rate if rate > 0.0 else high
            if not low < new < high:
                new = 0.5 * (low + high) if high < np.inf else max(2.0 * low, 0.0) + 1e3
            if new == p:
                break
            p = new
        pressure[i], dilation[i], saturation[i] = p, ratio, s


@kernel
def _sum_neighbours(first, second, weight, volume, value, sums):
    """Of each point the sum of w V of its neighbours, that of w V times their `value`, and the largest w."""
    for b in range(first.shape[0]):
        w = weight[b]
        if w == 0.0:
            continue
        for i, j in ((first[b], second[b]), (second[b], first[b])):
            sums[i, 0] += w * volume[j]
            sums[i, 1] += w * volume[j] * value[j]
            sums[i, 2] = max(sums[i, 2], w)
