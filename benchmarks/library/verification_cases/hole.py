"""V26: a hole in a plate under tension, its points on a lattice and on rings around it (Kirsch 1898).

Errors are relative: the L2 norm over the points of a row of what xx, yy and xy are off, over that of what they are. The
plate reaches to four radii of the hole; what lies beyond 3.5 is held where the exact displacement has it. The points of
both come from a file, as those of any body that no shape describes.
"""

import tempfile
from pathlib import Path

import numpy as np

from .common import BULK, DEFAULT, SHEAR, Figure, ImposedVelocity, owned, point_stress, simulation

POISSON = (3.0 * BULK - 2.0 * SHEAR) / (6.0 * BULK + 2.0 * SHEAR)
STRETCH = 1e-6  # far stress along x over the shear modulus
FAR, HELD = 4.0, 3.5  # radii of the hole, which is 1 m


def displacement(x):
    """Displacement (n, 2) m at places (n, 2) m around the hole, if the far stress is as large as mu (plane strain)."""
    r, angle = np.hypot(*x.T), np.arctan2(x[:, 1], x[:, 0])
    kappa, c, s = 3.0 - 4.0 * POISSON, np.cos(2.0 * angle), np.sin(2.0 * angle)
    out = (r * (kappa - 1.0 + 2.0 * c) + 2.0 / r * (1.0 + (kappa + 1.0) * c - c / r**2)) / 8.0
    along = -(2.0 * r + 2.0 / r * (kappa - 1.0 + 1.0 / r**2)) * s / 8.0
    e = x / r[:, None]
    return out[:, None] * e + along[:, None] * np.stack([-e[:, 1], e[:, 0]], axis=1)


def stress(x):
    """Stress (n, 3), xx, yy and xy, over the far one at places (n, 2) m around the hole."""
    r, angle = np.hypot(*x.T), np.arctan2(x[:, 1], x[:, 0])
    c, s, q = np.cos(2.0 * angle), np.sin(2.0 * angle), 1.0 / r**2
    radial = 0.5 * (1.0 - q + (1.0 - 4.0 * q + 3.0 * q**2) * c)
    hoop = 0.5 * (1.0 + q - (1.0 + 3.0 * q**2) * c)
    shear = -0.5 * (1.0 + 2.0 * q - 3.0 * q**2) * s
    mean, half = 0.5 * (radial + hoop), 0.5 * (radial - hoop)
    return np.stack([mean + half * c - shear * s, mean - half * c + shear * s, half * s + shear * c], axis=1)


def _places(points, rings):
    """Places (n, 2) m and areas (n,) m^2 of points with `points` spacings in the radius of the hole."""
    spacing = 1.0 / points
    if not rings:
        line = (np.arange(-FAR * points, FAR * points) + 0.5) * spacing
        x = np.stack(np.meshgrid(line, line, indexing="ij"), axis=2).reshape(-1, 2)
        r = np.hypot(*x.T)
        x = x[(r > 1.0) & (r < FAR)]
        return x, np.full(len(x), spacing**2)
    places, areas = [], []
    for ring in range(points, int(FAR * points)):
        count = round(np.pi * (2 * ring + 1))
        angle = 2.0 * np.pi * (np.arange(count) + 0.5) / count
        places.append((ring + 0.5) * spacing * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        areas.append(np.full(count, np.pi * (2 * ring + 1) * spacing**2 / count))
    return np.concatenate(places), np.concatenate(areas)


def _errors(points, rings, scheme):
    """Relative errors of the stress in the first, second and third spacing around the hole, and beyond."""
    spacing = 1.0 / points
    x, area = _places(points, rings)
    held = np.hypot(*x.T) > HELD
    with tempfile.TemporaryDirectory() as folder:
        bodies = []
        for name, chosen in (("plate", ~held), ("frame", held)):
            file = str(Path(folder) / f"{name}.csv")
            np.savetxt(file, np.column_stack([x, area])[chosen], delimiter=",", header="x,y,volume", comments="")
            bodies.append({"name": name, "material": "soil", "shape": {"type": "points", "file": file}})
        sim = simulation(
            spacing, [], scheme=scheme, bodies=bodies,
            boundaries={"frame": {"where": {"body": "frame"}, "fix": ["x", "y"]}},
            stages=[{"name": "settle", "type": "relax", "tolerance": 1e-5, "boundaries": ["frame"]}],
        )  # fmt: skip
    sim.start()
    place = owned(sim, "position").copy()
    chosen, sim.dt = sim.dt, 1.0
    ImposedVelocity(lambda q, dt: STRETCH * displacement(q) / dt).apply(sim.particles, 0.0, 1.0, False)
    owned(sim, "position")[:] += owned(sim, "velocity")
    sim.evaluate_forces()
    owned(sim, "velocity")[:] = 0.0
    sim.dt = chosen
    sim.run()
    found, exact = point_stress(sim)[:, [0, 1, 3]] / (STRETCH * SHEAR), stress(place)
    row = np.floor((np.hypot(*place.T) - 1.0) * points)
    errors = []
    for mine in (row == 0, row == 1, row == 2, (row > 2) & (np.hypot(*place.T) < 3.0)):
        errors.append(np.sqrt(((found - exact)[mine] ** 2).sum() / (exact[mine] ** 2).sum()))
    return errors


def hole_in_a_plate(full=False, scheme=DEFAULT):
    """V26: stress around a hole in a plate under tension (Kirsch 1898), its points on rings and on a lattice."""
    figures = []
    for points in (8, 16) if full else (6,):
        for rings in (True, False):
            errors = _errors(points, rings, scheme)
            what = f"{points} points in the radius, {'rings' if rings else 'lattice'}"
            for where, error in zip(("first row", "second row", "third row", "beyond"), errors, strict=True):
                target = (0.03 if points == 16 else 0.06) if rings else None
                figures.append(Figure(f"{what}: {where}", error, at_most=target))
    return figures
