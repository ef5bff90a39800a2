"""V6: a manufactured solution of linear elasticity."""

import numpy as np

from periporo.core.loads.boundary import Motion
from periporo.core.motion.stages import RelaxStage

from .common import DEFAULT, P_MODULUS, Figure, ImposedVelocity, box, order, owned, simulation

WAVE_NUMBER, AMPLITUDE = 1.5 * np.pi, 1e-7


def _exact(x):
    """Displacement (n, 2): amplitude (sin kx cos ky, cos kx sin ky), a gradient field."""
    a, b = WAVE_NUMBER * x[:, 0], WAVE_NUMBER * x[:, 1]
    return AMPLITUDE * np.stack([np.sin(a) * np.cos(b), np.cos(a) * np.sin(b)], axis=1)


class _BodyForce:
    """Force per volume 2 k^2 (K + 4 mu / 3) u, with which u is in equilibrium."""

    def add_force(self, p, time, dt):
        """Add to the external force."""
        density = 2.0 * WAVE_NUMBER**2 * P_MODULUS * _exact(p.initial_position)
        p.external_force[: p.owned] += p.volume[: p.owned, None] * density


class _Held(Motion):
    """Points that keep their place."""

    def __init__(self, ids):
        self.ids = ids

    def apply(self, p, time, dt, closing_step):
        """Stop them."""
        p.velocity[np.flatnonzero(np.isin(p.id[: p.owned], self.ids))] = 0.0

    def hold_zero(self, p, free):
        """Their components are not free."""
        free[np.isin(p.id[: p.owned], self.ids)] = 0.0


def solution_error(cells, jitter, scheme, **keys):
    """Relative L2 error of the displacement of the free points; `keys` of the input file may name another horizon.

    The unit square is framed to twice the depth of the horizon, so that no surface is felt, not even through the
    gradients of neighbours' neighbours. One step of prescribed motion takes all points to the exact solution; from
    there the free points relax.
    """
    spacing = 1.0 / cells
    depth = 2.0 * np.ceil(keys.get("horizon", 2.2)) * spacing
    sim = simulation(spacing, box([-depth, -depth], [1 + depth, 1 + depth]), scheme=scheme, jitter=jitter, **keys)
    sim.start()
    sim.prescribed_motions = [ImposedVelocity(lambda x, dt: _exact(x) / dt)]
    sim.step()
    start = owned(sim, "initial_position")
    inside = (np.abs(start - 0.5) < 0.5).all(axis=1)
    held = _Held(owned(sim, "id")[~inside].copy())
    tolerance = 1e-6  # of the load; as relaxation starts from the solution, 1e-4 would hide an error of 2e-4
    RelaxStage(
        name="equilibrium", prescribed_motions=[held], loads=[_BodyForce()], tolerance=tolerance, max_steps=20_000
    ).run(sim)
    start = owned(sim, "initial_position")
    inside = (np.abs(start - 0.5) < 0.5).all(axis=1)
    exact = _exact(start)[inside]
    return np.linalg.norm((owned(sim, "position") - start)[inside] - exact) / np.linalg.norm(exact)


def manufactured(full=False, scheme=DEFAULT):
    """V6: displacement against the exact solution on a grid and on a cloud with 10 % jitter."""
    return [
        *_convergence("grid", full, scheme, 0.0, 1.9),
        *_convergence("cloud of 10 % jitter", full, scheme, 0.1, 1.0 if full else 0.9),
    ]


def in_balance(full=False, scheme=DEFAULT):
    """V6: the same on the cloud, in balance."""
    return _convergence("cloud in balance", full, scheme, 0.1, 1.5)


def _convergence(name, full, scheme, jitter, least):
    resolutions = (8, 16, 32, 64) if full else (8, 16)
    errors = [solution_error(n, jitter, scheme) for n in resolutions]
    listed = [Figure(f"error on the {name}, h = 1/{n}", e) for n, e in zip(resolutions, errors, strict=True)]
    return [*listed, Figure(f"order on the {name}", order(errors), at_least=least)]
