"""Darcy's flux at points, from what flows along their pairs."""

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import kernel
from periporo.core.water.conductance import pair_conductance, stretched


def fluxes(p, pairs, net, factors) -> np.ndarray:
    """Flux (owned, d) m/s at the points of what flows through `net` (`FlowingWater.network`); collective by that.

    q_i = -F (J_i sum_j a_ij xi (x) xi)^-1 sum_j Q_ij xi, J the volume ratio, F the `factors` (d,) of the axes: exact
    where head falls evenly, also next to a surface, and of two layers in a row what flows through both. Points without
    neighbours have none.
    """
    d, n = p.dimension, p.owned
    moments, carried = np.zeros((p.total, d, d)), np.zeros((p.total, d))
    _sum_fluxes(
        pairs.first, pairs.second, pairs.weight, p.position, stretched(p.position, factors), p.volume, p.conduction,
        net.conducted, p.flow_state, moments, carried, p.dim,
    )  # fmt: skip
    trace = np.trace(moments[:n], axis1=1, axis2=2)
    alone = ~(np.linalg.det(moments[:n]) > 1e-9 * trace**d) & ~np.isnan(trace)
    moments[:n][alone], carried[:n][alone] = np.eye(d), 0.0
    return -factors * np.linalg.solve(moments[:n], carried[:n, :, None])[:, :, 0] / p.pore_dilation[:, None]


@kernel
def _sum_fluxes(
    first, second, weight, position, place, volume, conduction, conducted, state, moments, carried, dim
):
    """Sums of a xi (x) xi and of Q xi, Q what flows towards the point."""
    d = len(dim)
    for b in range(first.shape[0]):
        if conducted[b] == 0.0:
            continue
        i, j = first[b], second[b]
        a = pair_conductance(i, j, weight[b], place, volume, conduction, dim)
        xi = la.difference(position, i, j, dim)
        q = conducted[b] * 0.5 * (state[j, 1] + state[i, 1]) * (state[j, 0] - state[i, 0])
        for c in range(d):
            carried[i, c] += q * xi[c]
            carried[j, c] += q * xi[c]
            for e in range(d):
                moments[i, c, e] += a * xi[c] * xi[e]
                moments[j, c, e] += a * xi[c] * xi[e]
