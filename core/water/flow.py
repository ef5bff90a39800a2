"""Water that flows between points by Darcy's law, and through boundaries (`periporo.core.water.boundaries`).

dw_i/dt = sum_j Q_ij, Q_ij = a_ij kappa_ij [(p_j - p_i) - rho_w g . xi], with the conductances of
`periporo.core.water.conductance`, the mobility kappa = k k_r/mu: k of both ends in series, k_r their mean. What leaves
a point enters another, so that water is kept to rounding. In each step the pores change their volume first, then water
flows by explicit stages of second order whose stability grows with the square of their number (RKL2: Meyer, Balsara &
Aslam 2014). They need no inner products, so the bits are the same on any number of ranks.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Field
from periporo.core.ranks.reductions import exact_sum, maximum
from periporo.core.water import conductance
from periporo.core.water.content import porosity_of
from periporo.core.water.flux import fluxes
from periporo.core.water.increments import Increments
from periporo.core.water.pore_water import UndrainedWater
from periporo.core.water.retention import conductivity_of, saturation_of
from periporo.core.water.stages import integrate, stages_for
from periporo.errors import WaterError

_REFRESH = 20  # steps between looks at the geometry
MOST_STAGES = 199
TOO_FAST = (
    "the flow of water is too fast for the time step of {dt:.3g} s: are conductivity (m/s) and permeability (m^2, some "
    "1e-7 times that) in their units? Lower them or bulk_modulus, let water flow in a quasi_static stage, or take "
    "drained water"
)
CONTENT, DISSIPATED, ENTERED, LEFT, RAN_OFF = range(5)  # columns of the unknowns of a step; the last where rain falls
UNITS = {"water_stored": "m^3", "water_inflow": "m^3", "water_outflow": "m^3", "water_runoff": "m^3",
         "water_balance": "m^3", "flow_dissipation": "J", "water_energy": "J"}  # fmt: skip
"""Histories of the flow; `water_balance` is what is stored beyond the start, less what came in, plus what left."""


@dataclass(frozen=True)
class Permeability:
    """Mobility k/mu of full pores at the start, `mobility` (materials,) m^2/(Pa s).

    If it follows the porosity, then by Kozeny and Carman as phi^3/(1 - phi)^2. `gravity` (d,) m/s^2 is the scene's;
    `factors` (d,) are those of the permeability along the axes.
    """

    mobility: np.ndarray
    follows_porosity: bool
    gravity: np.ndarray
    factors: np.ndarray

    @property
    def direction(self) -> np.ndarray:
        """Unit vector (d,) along gravity, zero without."""
        strength = float(np.sqrt((self.gravity**2).sum()))
        return self.gravity / strength if strength > 0.0 else self.gravity


class Network(NamedTuple):
    """What conducts water: a J kappa of full pores (pairs,) m^3/(Pa s), boundaries with the faces that they have now.

    `sums` (total,) m^3/(Pa s) are those that the pairs of each point conduct with the present k_r.
    """

    conducted: np.ndarray
    inflows: list[tuple[Any, Any]]
    sums: np.ndarray


class FlowingWater(UndrainedWater):
    """Water that flows. In relaxation, which takes all the time in the world, it keeps its pressure.

    Point fields besides those of water that stays: `exchanged_water` (n, 4|5), what the point held at the start, m^3,
    what flow to and from it has dissipated, J, what has come in and left through boundaries, m^3, and, where it may
    rain, what of that has run off.
    """

    stays = False

    def __init__(self, pores, profile, free, permeability: Permeability, passed: Collection[str] = ()):
        """`passed` are the kinds of the boundaries through which water may go."""
        super().__init__(pores, profile, free, permeability.gravity)
        self.permeability = permeability
        self.sums = 5 if "rain" in passed else 4
        self.increments: Increments | None = None  # of quasi-static stages

    def attach(self, sim) -> None:
        """Declare the point fields."""
        super().attach(sim)
        sim.particles.add_field(conductance.field(sim.particles.dimension))
        sim.particles.add_field(Field("exchanged_water", self.sums, "m^3, J", sent=False))
        if self.increments is not None:
            self.increments.attach(sim)
        d, weight = sim.particles.dimension, self.pores.density * self.permeability.gravity
        self.derived = self.derived | {"flux": (d, "m/s", self._fluxes)}
        strength = float(np.sqrt((weight**2).sum()))
        if strength > 0.0:
            head = lambda p, n: (p.pore_pressure[:n] - (p.position[:n] * weight).sum(axis=1)) / strength  # noqa: E731
            self.derived = self.derived | {"head": (1, "m", head)}
        # p - rho_w g . x, k_r, J k/mu
        sim.particles.add_field(Field("flow_state", 3, "Pa, 1, m^2/(Pa s)", migrates=False))

    def _fluxes(self, p, n):
        return fluxes(p, self._sim.bonds.pairs, self.network(p), self.permeability.factors)

    def initial_fields(self, owned) -> None:
        """Set what the water is at new points."""
        super().initial_fields(owned)
        owned["exchanged_water"] = np.zeros((len(owned["id"]), self.sums))
        owned["exchanged_water"][:, CONTENT] = owned["water_content"]

    def _advance(self, p, dt):
        sim = self._sim
        if self.increments is not None and self.increments.running:
            self.increments.follow(p, dt)
            return
        if sim.step_number % _REFRESH == 0:  # at the start, too
            self.look_around(p)
        before = p.water_content.copy()
        super()._advance(p, dt)
        if sim.rate_independent:
            self.note_exchange(p, p.water_content - before)
        elif dt > 0.0:
            self._flow(p, dt)
            self.exchange(p, p.water_content)

    def note_exchange(self, p, gained) -> None:
        """Count as in- and outflow what the points have `gained` (owned,) m^3."""
        p.exchanged_water[:, ENTERED] += np.maximum(gained, 0.0)
        p.exchanged_water[:, LEFT] += np.maximum(-gained, 0.0)

    def look_around(self, p) -> None:
        """Find what pairs conduct where the points are now."""
        conductance.find_conduction(p, self._sim.bonds.pairs, self._sim.halo, self.permeability.factors)

    def histories(self) -> dict[str, float]:
        """What is stored, has come in and left, and the balance; what flow dissipates and water stores; collective."""
        p = self._sim.particles
        rows = np.column_stack([p.water_content, self.energies(p), p.exchanged_water])
        stored, energy, start, dissipated, entered, left, *ran_off = exact_sum(self._sim.comm, rows).tolist()
        balance = stored - start - entered + left
        found = stored, entered, left, sum(ran_off), balance, dissipated, energy
        return dict(zip(UNITS, found, strict=True))

    def _flow(self, p, dt):
        """Let water flow for `dt` s, in pores of constant volume."""
        net = self.network(p)
        stages = self.stages_within(p, net, dt)
        if not stages <= MOST_STAGES:
            raise WaterError(TOO_FAST.format(dt=dt))
        self.transport(p, net, self._sim.time, dt, stages, lambda gone: self._fill_pressure(p))

    def stages_within(self, p, net: Network, dt: float) -> float:
        """Stages that the flow through `net` needs in a step of `dt` s; collective."""
        return stages_for(0.5 * dt * self.fastest(p, net, np.zeros(p.owned)))

    def network(self, p) -> Network:
        """What conducts water at present; fills `flow_state`; collective."""
        pairs = self._sim.bonds.pairs
        self.describe(p)
        conducted, sums = np.empty(len(pairs.first)), np.zeros(p.total)
        _find_conducted(
            pairs.first, pairs.second, pairs.weight, conductance.stretched(p.position, self.permeability.factors),
            p.volume, p.conduction, p.flow_state, conducted, sums, p.dim,
        )  # fmt: skip
        inflows = self._sim.inflows
        outer = self.outer_faces(p) if inflows else None
        return Network(conducted, [(boundary, boundary.faces(p, outer)) for boundary in inflows], sums)

    def again(self, p, net: Network) -> Network:
        """The network with what it conducts by the `flow_state` of now."""
        pairs, sums = self._sim.bonds.pairs, np.zeros(p.total)
        _sum_conducted(pairs.first, pairs.second, net.conducted, p.flow_state, sums)
        return net._replace(sums=sums)

    def outer_faces(self, p) -> np.ndarray:
        """The faces that the owned points have now, see `conductance.outer_faces`."""
        return conductance.outer_faces(p, self._sim.bonds.pairs, self.permeability.factors)

    def transport(self, p, net: Network, begin: float, dt: float, stages: int, find_pressure) -> None:
        """Let water flow through `net` for `dt` s from the time `begin`.

        `find_pressure` is a function of the seconds gone that fills pressure and saturation from the content; those of
        the start are there, and so is its `flow_state`.
        """
        n, pairs, inflows = p.owned, self._sim.bonds.pairs, net.inflows
        start = np.zeros((n + 1, self.sums if inflows else ENTERED))  # the last row is a clock
        start[:n, CONTENT] = p.water_content

        def fill(state):
            p.water_content[:] = state[:n, CONTENT]
            find_pressure(state[n, CONTENT])

        def flow_of(state):
            if state is not start:
                fill(state)
                self.describe(p)
            flow = np.zeros((p.total + 1, start.shape[1]))
            _add_flows(pairs.first, pairs.second, net.conducted, p.flow_state, flow)
            for boundary, faces in inflows:
                boundary.add(p, faces, begin + state[n, CONTENT], self, flow)
            flow[n], flow[n, CONTENT] = 0.0, 1.0
            return flow[: n + 1]

        state = integrate(flow_of, start, dt, stages)
        p.exchanged_water[:, DISSIPATED : start.shape[1]] += state[:n, DISSIPATED:]
        fill(state)

    def describe(self, p):
        """Fill `flow_state` of all points."""
        _describe(
            p.owned, p.material, self.pores.porosity, self.curves, self.permeability.mobility,
            self.permeability.follows_porosity, p.pore_pressure, p.saturation, p.pore_dilation, p.flow_state,
        )  # fmt: skip
        self._sim.halo.update(p, "flow_state")
        if self.weight.any():  # of copies beyond a seam the place counts where they stand
            _subtract_weight(p.total, p.position, self.weight, p.flow_state, p.dim)

    def fastest(self, p, net: Network, compliance) -> float:
        """A bound on the fastest rate of the flow, 1/s: twice the sum of what each point conducts over its capacity.

        `compliance` (owned,) 1/Pa is the rate of `pore_dilation` with the pressure.
        """
        sums = net.sums.copy() if net.inflows else net.sums
        for boundary, faces in net.inflows:
            sums[faces.rows] += boundary.conducted(p, faces, self)
        return maximum(
            self._sim.comm,
            _largest_rate(
                p.owned, p.material, self.pores.porosity, self.curves, self.pores.bulk_modulus, p.volume,
                p.pore_dilation, p.pore_pressure, compliance, sums,
            ),
        )  # fmt: skip


def flowing_water(sim) -> FlowingWater:
    """The water that flows in a simulation."""
    return next(process for process in sim.point_processes if isinstance(process, FlowingWater))


@kernel
def _describe(owned, material, initial_porosity, curves, mobility, follows, pressure, saturation, dilation, state):
    for i in range(owned):
        m = material[i]
        state[i, 0] = pressure[i]
        state[i, 1] = conductivity_of(curves, m, -pressure[i], saturation[i])
        state[i, 2] = mobility[m]
        if follows:
            now, then = porosity_of(initial_porosity[m], dilation[i]), initial_porosity[m]
            state[i, 2] *= (now / then) ** 3 * ((1.0 - then) / (1.0 - now)) ** 2
        state[i, 2] *= dilation[i]


@kernel
def _subtract_weight(total, position, water_weight, state, dim):
    for i in range(total):
        for c in range(len(dim)):
            state[i, 0] -= water_weight[c] * position[i, c]


@kernel
def _find_conducted(first, second, weight, place, volume, conduction, state, conducted, sums, dim):
    """a J kappa of full pores, J the volume ratio, of every pair, and of each point the sum with the larger k_r."""
    for b in range(first.shape[0]):
        if weight[b] == 0.0:
            conducted[b] = 0.0
            continue
        i, j = first[b], second[b]
        a = conductance.pair_conductance(i, j, weight[b], place, volume, conduction, dim)
        both = state[i, 2] + state[j, 2]
        series = 2.0 * state[i, 2] * state[j, 2] / both if both > 0.0 else both
        conducted[b] = a * series
        value = conducted[b] * max(state[i, 1], state[j, 1])
        sums[i] += value
        sums[j] += value


@kernel
def _add_flows(first, second, conducted, state, flow):
    for b in range(first.shape[0]):
        if conducted[b] == 0.0:
            continue
        i, j = first[b], second[b]
        driven = state[j, 0] - state[i, 0]
        q = conducted[b] * driven * 0.5 * (state[j, 1] + state[i, 1])
        flow[i, CONTENT] += q
        flow[j, CONTENT] -= q
        flow[i, DISSIPATED] += 0.5 * q * driven
        flow[j, DISSIPATED] += 0.5 * q * driven


@kernel
def _sum_conducted(first, second, conducted, state, sums):
    for b in range(first.shape[0]):
        if conducted[b] == 0.0:
            continue
        i, j = first[b], second[b]
        value = conducted[b] * max(state[i, 1], state[j, 1])
        sums[i] += value
        sums[j] += value


@kernel
def _largest_rate(owned, material, initial_porosity, curves, bulk, volume, dilation, pressure, compliance, sums):
    largest = 0.0
    for i in range(owned):
        porosity = porosity_of(initial_porosity[material[i]], dilation[i])
        s, slope = saturation_of(curves, material[i], -pressure[i], porosity, dilation[i])
        squeezed = 1.0 + pressure[i] / bulk
        capacity = volume[i] * dilation[i] * porosity * (s / bulk - slope * squeezed)
        capacity += volume[i] * s * squeezed * compliance[i]
        rate = 2.0 * sums[i] / capacity
        if rate > largest or np.isnan(rate):  # and stays
            largest = rate
    return largest
