"""A column as a continuum: what the points of V23 and V24 are compared with.

Plane strain, nine-node elements, large rotations and strains; the stress is that of the law `elastic` where principal
strains keep their axes, sigma = 2 mu ln V + (K - 2/3 mu) tr(ln V) I. Dead tractions press the ends along x.
"""

import itertools

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(3)


def pressed(length, load, bulk, shear, *, bow=0.0, slope=0.0, elements=(32, 2)):
    """Rise of the middle over the ends, and the chord, in lengths, of a column one thickness (1 m) wide.

    `load` N/m presses its ends; it begins as a sine of `bow` lengths, and the search for its equilibrium as an arc with
    the `slope` (rad) at its ends. Raises RuntimeError if that finds none.
    """
    x, cells, columns = _mesh(length, elements)
    start = x.copy()
    start[:, 1] += bow * length * np.sin(np.pi * x[:, 0] / length)
    slopes, parts = _shape_slopes(start, cells)
    share = _simpson(elements[1])
    force = np.zeros((len(x), 2))
    force[columns[0], 0], force[columns[-1], 0] = load * share, -load * share
    middle = columns[len(columns) // 2]
    held = [2 * middle[len(middle) // 2], 2 * middle[len(middle) // 2] + 1, 2 * middle[-1]]
    free = np.setdiff1d(np.arange(2 * len(x)), held)
    u = _arc(x, length, slope) - x
    for _ in range(50):
        inner, matrix = _inner_force(u, cells, slopes, parts, bulk, shear)
        step = np.zeros(2 * len(x))
        step[free] = scipy.sparse.linalg.spsolve(matrix[free][:, free].tocsc(), (force - inner).ravel()[free])
        largest = np.abs(step).max()
        u += step.reshape(-1, 2) * min(1.0, 0.3 / largest)
        if largest < 1e-8 * length:
            break
    else:
        raise RuntimeError(f"no equilibrium of a column of {length} thicknesses under {load} N/m in 50 iterations")
    left, centre, right = (share @ (start + u)[columns[k]] for k in (0, len(columns) // 2, -1))
    along = (right - left) / np.linalg.norm(right - left)
    rise = along[0] * (centre - left)[1] - along[1] * (centre - left)[0]
    return abs(rise) / length, np.linalg.norm(right - left) / length


def _mesh(length, elements):
    """Nodes (n, 2), those of each element (e, 9), and of each column of nodes."""
    across = 2 * elements[1] + 1
    x = np.linspace(0.0, length, 2 * elements[0] + 1)
    nodes = np.stack(np.meshgrid(x, np.linspace(-0.5, 0.5, across), indexing="ij"), axis=2).reshape(-1, 2)
    columns = np.arange(len(nodes)).reshape(-1, across)
    cells = [
        columns[i : i + 3, j : j + 3].ravel() for i in range(0, 2 * elements[0], 2) for j in range(0, across - 1, 2)
    ]
    return nodes, np.array(cells), columns


def _simpson(elements):
    """Parts of a uniform load on a column of nodes."""
    parts = np.zeros(2 * elements + 1)
    for k in range(elements):
        parts[2 * k : 2 * k + 3] += np.array([1.0, 4.0, 1.0]) / 6.0 / elements
    return parts


def _arc(x, length, slope):
    """Nodes of the straight column `x` on an arc with the slope at its ends."""
    if slope == 0.0:
        return x
    radius = 0.5 * length / slope
    angle = (x[:, 0] - 0.5 * length) / radius
    r = radius + x[:, 1]
    return np.stack([0.5 * length + r * np.sin(angle), r * np.cos(angle) - radius], axis=1)


def _shape_slopes(x, cells):
    """Slopes (g, e, 9, 2) of the shape functions at the integration points, and the areas (g, e) of these."""
    slopes, areas = [], []
    for (p, wp), (q, wq) in itertools.product(zip(_PLACES, _WEIGHTS, strict=True), repeat=2):
        (lp, dp), (lq, dq) = _quadratics(p), _quadratics(q)
        inner = np.stack([np.outer(dp, lq).ravel(), np.outer(lp, dq).ravel()], axis=1)
        jacobian = np.einsum("ena,nb->eab", x[cells], inner)
        slopes.append(inner @ np.linalg.inv(jacobian))
        areas.append(np.linalg.det(jacobian) * wp * wq)
    return np.array(slopes), np.array(areas)


def _quadratics(g):
    """Lagrange's quadratics through -1, 0, 1 at g, and their slopes."""
    return np.array([g * (g - 1.0) / 2.0, 1.0 - g * g, g * (g + 1.0) / 2.0]), np.array([g - 0.5, -2.0 * g, g + 0.5])


def _inner_force(u, cells, slopes, parts, bulk, shear):
    """Forces (n, 2) N/m of the nodes, and their slopes over the displacements `u`, a sparse matrix."""
    f = np.eye(2) + np.einsum("ena,genb->geab", u[cells], slopes)
    force, nudge = np.zeros_like(u), 1e-6
    np.add.at(force, cells, np.einsum("geab,genb,ge->ena", _nominal(f, bulk, shear), slopes, parts))
    moduli = np.empty((*f.shape, 2, 2))
    for c, d in np.ndindex(2, 2):
        change = np.zeros((2, 2))
        change[c, d] = nudge
        difference = _nominal(f + change, bulk, shear) - _nominal(f - change, bulk, shear)
        moduli[..., c, d] = difference / (2.0 * nudge)
    matrix = np.einsum("geabcd,genb,gemd,ge->enamc", moduli, slopes, slopes, parts)
    rows = (2 * cells[:, :, None] + np.arange(2)).reshape(len(cells), -1)
    places = np.repeat(rows, rows.shape[1], axis=1).ravel(), np.tile(rows, rows.shape[1]).ravel()
    return force, scipy.sparse.csr_matrix((matrix.ravel(), places), shape=(u.size, u.size))


def _nominal(f, bulk, shear):
    """First Piola-Kirchhoff stress (..., 2, 2) Pa of the deformation gradient `f`."""
    squares, axes = np.linalg.eigh(f @ np.swapaxes(f, -1, -2))
    strain = 0.5 * np.log(squares)
    principal = 2.0 * shear * strain + (bulk - 2.0 / 3.0 * shear) * strain.sum(axis=-1, keepdims=True)
    stress = (axes * principal[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return np.linalg.det(f)[..., None, None] * stress @ np.swapaxes(np.linalg.inv(f), -1, -2)
