"""What it takes to make a cloud of displaced points as accurate as a grid: bonds in balance under uniform stress.

    python -m benchmarks balanced_bonds [--quick] [--jitter 0.1]

On displaced points the forces of a uniform stress do not balance, g_i = sum_b c_b dL_b/dv_i is not zero, and points
move until they do: the cloud is softer than its material. This script assembles the linear operator of
`bond_projected` in the plane (cubic influence, horizon 2.2 spacings) as a sparse matrix, changes it in three ways, and
solves the manufactured problem V6 with each; the table goes to docs/figures/balanced_bonds.md.

  weights  shares of volume c_b (1 + d_b) with the smallest d for which g = 0 and every point keeps its volume
  tilt     q_ij = xi/|xi|^2 + a_j - a_i in place of xi/|xi|^2 in L_ij = L + (v_j - v_i - L xi) (x) q_ij, with one
           vector a_i for each point, from g = 0: linear fields stay exact, the operator symmetric and positive
  tilt, n  the same after n conjugate-residual iterations in place of a direct solution
"""


import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as solvers
from scipy.spatial import cKDTree

from . import FIGURES, option_parser

TABLE = FIGURES / "balanced_bonds.md"
BULK, SHEAR = 25e6, 15e6  # Pa
LAME = BULK - 2.0 / 3.0 * SHEAR
HORIZON = 2.2  # spacings
WAVE_NUMBER = 1.5 * np.pi
AXES = (0, 1)


def exact(x):
    """Displacement (n, 2) of V6."""
    a, b = WAVE_NUMBER * x[:, 0], WAVE_NUMBER * x[:, 1]
    return np.stack([np.sin(a) * np.cos(b), np.cos(a) * np.sin(b)], axis=1)


class Cloud:
    """Points of a unit square with three layers around it, and the operators of its bonds.

    `mean`, `residual`: for each bond the mean L of the points' gradients, and v_j - v_i - L xi, as matrices that act on
    the values of one velocity component at the points. `inside` marks the free points.
    """

    def __init__(self, cells: int, jitter: float):
        self.h = 1.0 / cells
        line = (np.arange(-3, cells + 3) + 0.5) * self.h
        x = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
        self.x = x = x + jitter * self.h * np.random.default_rng(1).uniform(-1.0, 1.0, x.shape)
        self.inside = (np.abs(x - 0.5) < 0.5).all(axis=1)
        i, j = cKDTree(x).query_pairs(HORIZON * self.h, output_type="ndarray").T
        self.i, self.j, n = i, j, len(x)
        xi = x[j] - x[i]
        self.normal = xi / (xi**2).sum(axis=1)[:, None]
        bonds = np.arange(len(i))
        weight = _cubic(np.linalg.norm(xi, axis=1) / (HORIZON * self.h)) * self.h**2
        around = np.bincount(i, weight, n) + np.bincount(j, weight, n)
        self.share = weight * self.h**2 * (1.0 / around[i] + 1.0 / around[j])
        squares = weight[:, None, None] * xi[:, :, None] * xi[:, None, :]
        shape = np.zeros((n, 2, 2))
        np.add.at(shape, i, squares)
        np.add.at(shape, j, squares)
        inverse = np.linalg.inv(shape)
        difference = sp.csr_matrix((np.r_[0 * i + 1.0, 0 * i - 1.0], (np.r_[bonds, bonds], np.r_[j, i])), (len(i), n))
        ends = sp.csr_matrix((np.full(2 * len(i), 0.5), (np.r_[bonds, bonds], np.r_[i, j])), (len(i), n))
        self.difference, self.ends, self.mean = difference, ends, []
        for a in AXES:
            at_i, at_j = (weight * (inverse[k, a] * xi).sum(axis=1) for k in (i, j))
            incidence = sp.csr_matrix((np.r_[at_i, at_j], (np.r_[i, j], np.r_[bonds, bonds])), (n, len(i)))
            self.mean.append(ends @ incidence @ difference)
        self.residual = difference - sum(sp.diags(xi[:, a]) @ self.mean[a] for a in AXES)

    def gradient(self, direction):
        """Per axis the matrix from values at the points to the gradients of the bonds, with q = `direction` (b, 2)."""
        return [(self.mean[a] + sp.diags(direction[:, a]) @ self.residual).tocsr() for a in AXES]

    def imbalance(self, share, gradient):
        """g (n, 2), m, per volume of a cell and times the spacing: 0 if forces of uniform stress balance."""
        return np.stack([gradient[a].T @ share for a in AXES], axis=1) / self.h

    def error(self, share, gradient):
        """Relative L2 error of the displacement of the free points in V6."""
        stiffness = sp.bmat([[self._stiffness(share, gradient, p, q) for q in AXES] for p in AXES]).tocsr()
        solution = exact(self.x)
        load = 2.0 * WAVE_NUMBER**2 * (BULK + 4.0 / 3.0 * SHEAR) * self.h**2 * solution.T.ravel()
        free = np.flatnonzero(np.tile(self.inside, 2))
        held = np.flatnonzero(~np.tile(self.inside, 2))
        u = solution.T.ravel()
        right = load[free] - stiffness[free][:, held] @ u[held]
        found = solvers.spsolve(stiffness[free][:, free].tocsc(), right)
        return np.linalg.norm(found - u[free]) / np.linalg.norm(u[free])

    def _stiffness(self, share, gradient, p, q):
        """Block of the stiffness that couples velocity components p and q."""
        total = LAME * gradient[p].T @ sp.diags(share) @ gradient[q]
        total = total + SHEAR * gradient[q].T @ sp.diags(share) @ gradient[p]
        if p == q:
            total = total + SHEAR * sum(g.T @ sp.diags(share) @ g for g in gradient)
        return total


def _cubic(r):
    """Cubic B-spline of the distance over the horizon."""
    q = 2.0 * r
    return np.where(q < 1.0, 1.0 - 1.5 * q**2 + 0.75 * q**3, np.where(q < 2.0, 0.25 * (2.0 - q) ** 3, 0.0))


def balanced_weights(cloud):
    """Shares of the bonds with balance and the volume of every free point, changed as little as that allows."""
    gradient, c = cloud.gradient(cloud.normal), cloud.share
    free = cloud.inside
    volumes = cloud.ends.T.tocsr()[free] @ sp.diags(c) / cloud.h**2
    balance = [g.T.tocsr()[free] @ sp.diags(c) / cloud.h for g in gradient]
    system = sp.vstack([*balance, volumes]).tocsr()
    g = cloud.imbalance(c, gradient)[free]
    missing = np.concatenate([-g[:, 0], -g[:, 1], 1.0 - np.asarray(volumes.sum(axis=1)).ravel()])
    return c * (1.0 + system.T @ solvers.spsolve((system @ system.T).tocsc(), missing))


def tilted(cloud, iterations=None):
    """Directions q (b, 2) with balance at the free points, or what `iterations` make of it."""
    free = cloud.inside
    scaled = sp.diags(cloud.share) / cloud.h
    system = (cloud.residual.T.tocsr()[free] @ scaled @ cloud.difference.tocsc()[:, free]).tocsc()
    missing = -cloud.imbalance(cloud.share, cloud.gradient(cloud.normal))[free]
    tilt = np.zeros_like(cloud.x)
    for a in AXES:
        if iterations is None:
            tilt[free, a] = solvers.spsolve(system, missing[:, a])
        else:
            tilt[free, a] = conjugate_residual(system, missing[:, a], iterations)
    return cloud.normal + cloud.difference @ tilt


def conjugate_residual(system, right, iterations):
    """Generalised conjugate residuals (Eisenstat, Elman & Schultz 1983) from zero."""
    x, r, directions = np.zeros_like(right), right.copy(), []
    for _ in range(iterations):
        p, image = r, system @ r
        for q, other in directions:
            overlap = image @ other
            p, image = p - overlap * q, image - overlap * other
        size = np.linalg.norm(image)
        p, image = p / size, image / size
        directions.append((p, image))
        step = r @ image
        x, r = x + step * p, r - step * image
    return x


def main(words=None):
    """Solve, print, and write the table."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="coarse clouds; the table is only printed")
    parser.add_argument("--jitter", type=float, default=0.1, help="largest shift of a point along an axis, spacings")
    arguments = parser.parse_args(words)
    resolutions = (8, 16) if arguments.quick else (8, 16, 32, 64)
    rows = {}
    for cells in resolutions:
        cloud = Cloud(cells, arguments.jitter)
        plain, weights = cloud.gradient(cloud.normal), balanced_weights(cloud)
        rows.setdefault("as it is", []).append((cloud.error(cloud.share, plain), cloud, cloud.share, cloud.normal))
        rows.setdefault("weights", []).append((cloud.error(weights, plain), cloud, weights, cloud.normal))
        for name, iterations in (("tilt", None), ("tilt, 5", 5), ("tilt, 20", 20)):
            q = tilted(cloud, iterations)
            rows.setdefault(name, []).append((cloud.error(cloud.share, cloud.gradient(q)), cloud, cloud.share, q))
    errors = " | ".join(f"h = 1/{n}" for n in resolutions)
    lines = [f"| bonds | {errors} | order | imbalance | smallest share | tilt |"]
    lines.append("|---" * (len(resolutions) + 5) + "|")
    for name, results in rows.items():
        errors = [r[0] for r in results]
        _, cloud, share, q = results[-1]
        g = cloud.imbalance(share, cloud.gradient(q))[cloud.inside]
        tilt = np.sqrt(((q - cloud.normal) ** 2).sum() / (cloud.normal**2).sum())
        lines.append(
            f"| {name} | {' | '.join(f'{e:.4f}' for e in errors)} | {np.log2(errors[-2] / errors[-1]):.2f} | "
            f"{np.sqrt((g**2).mean()):.1e} | {(share / cloud.share).min():.2f} | {tilt:.2f} |"
        )
    print("\n".join(lines))
    if not arguments.quick:
        TABLE.write_text("\n".join(lines) + "\n")
