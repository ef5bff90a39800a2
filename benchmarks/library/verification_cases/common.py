"""What the verification cases share: figures with their targets, small scenes, and views of a simulation."""

from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from periporo.core.loads.boundary import Motion
from periporo.core.points import fields
from periporo.core.scene.build import build
from periporo.core.watch.observers import Observer
from periporo.io.input.load import parse_scene

BULK, SHEAR, DENSITY, GRAVITY = 25e6, 15e6, 1760.0, 9.81
P_MODULUS = BULK + 4.0 / 3.0 * SHEAR
P_SPEED, S_SPEED = np.sqrt(P_MODULUS / DENSITY), np.sqrt(SHEAR / DENSITY)
ELASTIC = {"model": "elastic", "density": DENSITY, "bulk_modulus": BULK, "shear_modulus": SHEAR}
CAM_CLAY = {
    "model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": BULK, "shear_modulus": SHEAR,
    "critical_state_slope": 1.1, "compression_index": 0.12, "swelling_index": 0.04, "overconsolidation_ratio": 1.25,
}  # fmt: skip


@dataclass(frozen=True)
class Figure:
    """A measured number and what it must meet; without a target it is recorded only."""

    what: str
    value: float
    at_most: float | None = None
    at_least: float | None = None

    @property
    def met(self) -> bool:
        """Whether the target is met; NaN never meets one."""
        above = self.at_least is None or self.value >= self.at_least
        return above and (self.at_most is None or self.value <= self.at_most)

    @property
    def target(self) -> str:
        """The target in words."""
        bounds = [f">= {self.at_least:.4g}"] if self.at_least is not None else []
        bounds += [f"<= {self.at_most:.4g}"] if self.at_most is not None else []
        return ", ".join(bounds) or "recorded"


def order(errors, factor=2.0) -> float:
    """Order of convergence from the last two errors, whose resolutions differ by `factor`."""
    return float(np.log(errors[-2] / errors[-1]) / np.log(factor))


DEFAULT = {"scheme": "point_state", "sharpened": True, "regular": True}  # that of a scene that names none


def simulation(spacing, shapes, *, dimension=2, scheme=DEFAULT, material=ELASTIC, jitter=0.0, **scene):
    """A simulation, not started, of bodies of one material; `scene` holds more keys of the input file."""
    shapes = shapes if isinstance(shapes, list) else [shapes]
    bodies = [{"name": f"body{k}", "material": "soil", "shape": s, "jitter": jitter} for k, s in enumerate(shapes)]
    scene.setdefault("stages", [{"name": "motion", "type": "dynamics", "duration": 1.0}])
    model = {"dimension": dimension, "spacing": spacing, "correspondence": scheme, "bodies": bodies}
    return build(parse_scene(model | {"materials": {"soil": material}} | scene), MPI.COMM_SELF)


def box(lower, upper):
    """Shape of a box, for `simulation`."""
    return {"type": "box", "lower": list(lower), "upper": list(upper)}


def owned(sim, name):
    """The owned rows of a point field."""
    return getattr(sim.particles, name)[: sim.particles.owned]


def point_stress(sim):
    """Stress (n, 4|6) Pa of the points, as it is written to result files."""
    return fields.values(sim, ("stress",))["stress"]


def hooke(strain):
    """Stress rows of strain rows (n, 4|6), Pa."""
    stress = 2.0 * SHEAR * strain
    stress[:, :3] += (BULK - 2.0 / 3.0 * SHEAR) * strain[:, :3].sum(axis=1, keepdims=True)
    return stress


class ImposedVelocity(Motion):
    """Moves every point with velocity(position, dt) in the middle of a step of dt: a prescribed motion in space."""

    def __init__(self, velocity):
        self.velocity = velocity

    def apply(self, p, time, dt, closing_step):
        """Overwrite what the kick did to the velocity."""
        if not closing_step:
            p.velocity[: p.owned] = self.velocity(p.position[: p.owned], dt)


class Recorder(Observer):
    """Keeps what function(sim) returns after every `interval` steps, with the time in front."""

    def __init__(self, function, interval=1):
        self.function = function
        self.interval = interval
        self.rows = []

    def after_step(self, sim):
        """Record."""
        if sim.step_number % self.interval == 0:
            self.rows.append((sim.time, *np.atleast_1d(self.function(sim))))

    def columns(self):
        """Time, and each recorded quantity, as arrays."""
        return np.array(self.rows).T


def row_volumes(sim, held):
    """Volume (n,) m^3 that each row of a block, or each link, stands for, 0 for rows without state."""
    rows = np.arange(len(held.active))
    return held.active * held.layout.volumes(held, sim.bonds.pairs, sim.particles, rows)


def link_rates(sim, dt=0.0):
    """Rate (n,) 1/s in the middle of a step of `dt` of the non-affine strain along each pair: its link works on it."""
    p, pairs, d = sim.particles, sim.bonds.pairs, sim.particles.dimension
    xi = p.position[pairs.second] - p.position[pairs.first]
    velocity = p.velocity[pairs.second] - p.velocity[pairs.first]
    mean = 0.5 * (p.gradient[pairs.first] + p.gradient[pairs.second]).reshape(-1, d, d)
    residual = velocity - np.einsum("nab,nb->na", mean, xi)
    residual += 0.5 * dt * np.einsum("nab,nb->na", mean, residual)
    xi = xi - 0.5 * dt * velocity
    return (xi * residual).sum(axis=1) / np.maximum((xi**2).sum(axis=1), sim.scheme.closest**2)


def contract(a, b):
    """a : b of rows of tensor components, (n,)."""
    return (a[:, :3] * b[:, :3]).sum(axis=1) + 2.0 * (a[:, 3:] * b[:, 3:]).sum(axis=1)


def strain_energy(sim):
    """Sum of c sigma : C^-1 : sigma / 2 over the rows of an elastic scene, and of c s^2 / 2E over its links, J."""
    total = 0.0
    for block in sim.bonds.blocks:
        s = block.stress
        p = s[:, :3].sum(axis=1) / 3.0
        deviatoric = contract(s, s) - 3.0 * p**2
        total += float((row_volumes(sim, block) * (p**2 / BULK + deviatoric / (2.0 * SHEAR))).sum()) / 2.0
    if sim.bonds.links is not None:
        links = sim.bonds.links
        total += float((row_volumes(sim, links) * links.stress[:, 0] ** 2).sum()) / P_MODULUS / 2.0
    return total
