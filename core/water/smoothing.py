"""Smooth pore pressure where saturated soil flows: not where it is elastic, or where pores have air, which is soft.

Between points that pass each other the volume is noise (`periporo.core.correspondence.regularity`), which nearly
incompressible water multiplies by K_w/phi. So points exchange water with their neighbours, as they exchange stress: in
each step a part of the difference of their pressures beyond that of water at rest, by the Courant number of undrained
waves, and the more the more active they are (diffusion of pressure, Molteni & Colagrossi 2009). What leaves a point
enters another. `python -m benchmarks verification --case W11` measures what is left.
"""

from periporo.core.correspondence.regularity import ACTIVITY, EXCHANGE, MOST_EXCHANGED, SIZE
from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Field

_HALF = 0.1  # activity at which half of the full exchange acts
FIELD = Field("smoothing", 3, "Pa, m^3/Pa, 1", migrates=False)  # p, what its rise takes, the part of a difference


def describe(p, pore_stiffness, dt: float) -> None:
    """Fill `smoothing` of the owned points, whose water adds `pore_stiffness` (owned,) Pa to the soil's."""
    _describe(p.owned, dt, pore_stiffness, p.pore_pressure, p.saturation, p.pore_dilation, p.volume, p.mass, p.flow,
              p.smoothing)  # fmt: skip


def exchange(p, pairs, weight, gained) -> None:
    """Add to `gained` (total,) m^3 what points get from their neighbours; `weight` (d,) is rho_w g N/m^3."""
    _exchange(pairs.first, pairs.second, pairs.weight, p.position, p.volume, p.share, p.smoothing, weight, gained,
              p.dim)  # fmt: skip


@kernel
def _describe(owned, dt, stiffness, pressure, saturation, dilation, volume, mass, flow, smoothing):
    for i in range(owned):
        smoothing[i, 0] = pressure[i]
        size = volume[i] * dilation[i]
        active = saturation[i] >= 1.0 and stiffness[i] > 0.0 and flow[i, SIZE] > 0.0
        smoothing[i, 1] = size / stiffness[i] if active else 0.0
        speed = (stiffness[i] * size / mass[i]) ** 0.5
        courant = dt * speed / flow[i, SIZE] if active else 0.0
        smoothing[i, 2] = min(EXCHANGE * courant, MOST_EXCHANGED) * flow[i, ACTIVITY] / (flow[i, ACTIVITY] + _HALF)


@kernel
def _exchange(first, second, weight, position, volume, share, smoothing, water_weight, gained, dim):
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        part = 0.5 * (smoothing[i, 2] + smoothing[j, 2])
        if weight[b] == 0.0 or part == 0.0:
            continue
        xi = la.difference(position, i, j, dim)
        driven = smoothing[j, 0] - smoothing[i, 0]
        for c in range(len(dim)):
            driven -= water_weight[c] * xi[c]
        near = 0.5 * weight[b] * (volume[j] * share[i, 0] + volume[i] * share[j, 0])
        q = part * near * min(smoothing[i, 1], smoothing[j, 1]) * driven
        gained[i] += q
        gained[j] -= q
