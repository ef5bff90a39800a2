"""Conductances between points, of the geometry alone: flow along pairs that is exact in a uniform gradient.

The flow from j to i is a_ij kappa_ij [(p_j - p_i) - rho_w g . xi], with one symmetric conductance for each pair,

    a_ij = w V_i V_j n . Lambda n / |xi|^2,  n = xi/|xi|,

so that water is kept to rounding, nothing flows in water at rest, and no pressure lies outside its neighbours' and the
boundaries'. The tensor Lambda_i of a point is chosen so that its pairs conduct as the continuum does, also where the
points have come closer in one direction,

    sum_j w V_j (n . Lambda n) n (x) n = 2 I,

for every pair belongs to two points. A pair takes the Lambda of the end with more neighbours (the larger W = sum w
V): at a surface that is the inner one, whose neighbourhood is whole, so that the flow into the first row is right.
Negative n . Lambda n count as 0. Lambda of points at the surface, which only pairs along it take, is then multiplied
by what is missing to the conductance along the surface, or along the edge. Next to a surface sum_j a_ij xi points
inwards and is as long as the area of the point's face.

Where water flows more easily along one axis than along another, by `factors`, all of this holds in places whose axes
are stretched by the inverse roots of them: there it flows equally easily in all directions.
"""

import numpy as np

from periporo.core.numerics import algebra as la
from periporo.core.numerics.jit import inlined, kernel
from periporo.core.points.particles import Field, scalars, symmetric

_FACE = 0.5  # of the face of a cell: a smaller sum of directions is the unevenness of points inside
_TURNS, _AT_ONCE = 2, 1.4  # in which conductances along the surface are fitted; more than all, as some pairs stay
_ACROSS, _ALONG = 0.6, 0.8  # of what the continuum conducts: less is the way through a surface, more one along it
_MOST_FITTED = 1.25  # factor of them in a turn
_FLOOR = 1e-9  # of W, on the diagonal: directions in which there is no pair do not count


def field(dimension: int) -> Field:
    """What points need for it: W and Lambda; W is 0 of points without regular company."""
    columns = 1 + dimension * (dimension + 1) // 2
    return Field("conduction", columns, "m^3, 1/m^3", axes=(*scalars(1), *symmetric(dimension)))


def find_conduction(p, pairs, halo, factors) -> None:
    """Find `conduction` of all points from the present positions; collective.

    `factors` (d,) are what water flows more easily by along the axes.
    """
    d, n, place = p.dimension, p.owned, stretched(p.position, factors)
    k = d * (d + 1) // 2
    upper = np.triu_indices(k)
    sums = np.zeros((p.total, 1 + len(upper[0])))
    _sum_moments(pairs.first, pairs.second, pairs.weight, place, p.volume, sums, p.dim)
    regular = (p.share[:n, 1] > 0.0) & (sums[:n, 0] > 0.0)
    whole = np.where(regular, sums[:n, 0], 1.0)
    matrix = np.zeros((n, k, k))
    matrix[:, upper[0], upper[1]] = matrix[:, upper[1], upper[0]] = sums[:n, 1:] * regular[:, None]
    matrix[:, range(k), range(k)] += (np.where(regular, _FLOOR, 1.0) * whole)[:, None]
    unit = 2.0 * (np.arange(k) < d)
    solved = np.linalg.solve(matrix, np.broadcast_to(unit[:, None], (n, k, 1)))[:, :, 0]
    p.conduction[:n, 0], p.conduction[:n, 1:] = whole * regular, solved * regular[:, None]
    for _ in range(_TURNS):
        halo.update(p, "conduction")
        _fit_surface(p, _stretched_faces(p, pairs, factors))
    halo.update(p, "conduction")


def outer_faces(p, pairs, factors) -> np.ndarray:
    """Outward area vectors A m^2 of the faces of the owned points, and sums of a xi (x) xi m^3 of stretched xi.

    (owned, d + d (d + 1)/2), zeros of points inside, from `conduction` and the present positions.
    """
    face = _stretched_faces(p, pairs, factors)
    face[:, : p.dimension] /= np.sqrt(factors)
    return face


def _fit_surface(p, face) -> None:
    """Multiply Lambda of points at the surface by what conducts along it too little, or too much.

    Along a face and along an edge sums of a xi (x) xi are nearly those of the continuum, across them about half: so the
    eigenvalues tell which ways go on. In the corner of a body none does.
    """
    d = p.dimension
    rows = np.flatnonzero((face[:, :d] != 0.0).any(axis=1))
    tensor = np.empty((len(rows), d, d))
    for c, (a, b) in enumerate(symmetric(d)):
        tensor[:, a, b] = tensor[:, b, a] = face[rows, d + c] / (2.0 * p.volume[rows])
    conducted = np.linalg.eigvalsh(tensor)
    goes_on = np.clip((conducted - _ACROSS) / (_ALONG - _ACROSS), 0.0, 1.0)
    ways, found = goes_on.sum(axis=1), (goes_on * conducted).sum(axis=1)
    factor = 1.0 + _AT_ONCE * (np.divide(ways, found, out=np.ones(len(rows)), where=ways > 0.0) - 1.0)
    p.conduction[rows, 1:] *= np.clip(factor, 1.0 / _MOST_FITTED, _MOST_FITTED)[:, None]


def _stretched_faces(p, pairs, factors):
    """`outer_faces` with A in places in which water flows equally easily in all directions."""
    d = p.dimension
    sums = np.zeros((p.total, d + d * (d + 1) // 2))
    _sum_directions(
        pairs.first, pairs.second, pairs.weight, stretched(p.position, factors), p.volume, p.conduction, sums, p.dim
    )  # fmt: skip
    _turn_outwards(p.owned, p.volume, factors, sums, p.dim)
    return sums[: p.owned]


def stretched(position, factors) -> np.ndarray:
    """Places (total, d) m in which water flows equally easily in all directions."""
    return position if (factors == 1.0).all() else position / np.sqrt(factors)


@inlined
def pair_conductance(i, j, w, position, volume, conduction, dim):
    """a_ij m of a pair of weight `w`, for the volumes at the start; `position` is stretched."""
    end = i if conduction[i, 0] >= conduction[j, 0] else j
    if w == 0.0 or conduction[i, 0] == 0.0 or conduction[j, 0] == 0.0:
        return 0.0
    xi = la.difference(position, i, j, dim)
    square, r2 = la.square(xi), la.dot(xi, xi)
    along = 0.0
    for c in range(len(square)):
        along += conduction[end, 1 + c] * square[c]
    return w * volume[i] * volume[j] * max(along, 0.0) / (r2 * r2)


@kernel
def _sum_moments(first, second, weight, position, volume, sums, dim):
    """W, and the upper triangle of sum w V e e^T with the components e of n (x) n."""
    for b in range(first.shape[0]):
        if weight[b] == 0.0:
            continue
        i, j = first[b], second[b]
        xi = la.difference(position, i, j, dim)
        square, r2 = la.square(xi), la.dot(xi, xi)
        to_first, to_second = weight[b] * volume[j], weight[b] * volume[i]
        sums[i, 0] += to_first
        sums[j, 0] += to_second
        column = 1
        for c in range(len(square)):
            for e in range(c, len(square)):
                value = square[c] * square[e] / (r2 * r2)
                sums[i, column] += to_first * value
                sums[j, column] += to_second * value
                column += 1


@kernel
def _sum_directions(first, second, weight, position, volume, conduction, sums, dim):
    """Sums of a xi and of a xi (x) xi."""
    d = len(dim)
    for b in range(first.shape[0]):
        i, j = first[b], second[b]
        a = pair_conductance(i, j, weight[b], position, volume, conduction, dim)
        xi = la.difference(position, i, j, dim)
        square = la.square(xi)
        for c in range(d):
            sums[i, c] += a * xi[c]
            sums[j, c] -= a * xi[c]
        for c in range(len(square)):
            sums[i, d + c] += a * square[c]
            sums[j, d + c] += a * square[c]


@kernel
def _turn_outwards(owned, volume, factors, sums, dim):
    """Turn the sums of directions outwards; zeros of points that have no face."""
    d = len(dim)
    for i in range(owned):
        square = 0.0
        for c in range(d):
            square += sums[i, c] ** 2 / factors[c]
        at_surface = square > (_FACE * volume[i] ** ((d - 1.0) / d)) ** 2
        for c in range(sums.shape[1]):
            sums[i, c] = (-sums[i, c] if c < d else sums[i, c]) if at_surface else 0.0
