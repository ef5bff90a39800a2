"""V4: the energy ledger."""

import numpy as np

from .common import (
    CAM_CLAY,
    DEFAULT,
    ELASTIC,
    GRAVITY,
    P_SPEED,
    Figure,
    ImposedVelocity,
    box,
    contract,
    link_rates,
    order,
    owned,
    row_volumes,
    simulation,
)


class _Unsteady:
    """A time step that changes threefold from step to step, whatever the simulation would choose."""

    def __init__(self, largest):
        self.largest = largest

    def due(self, step):
        """In every step."""
        return True

    def choose(self, sim):
        """Between a third of the largest and the largest."""
        return self.largest * (2.0 + np.sin(1.7 * sim.step_number)) / 3.0


def ledger(full=False, scheme=DEFAULT):
    """V4 (a): a yielding column falls on a rough floor, pushed by a driven layer, damped, with unsteady steps."""
    spacing, steps = (0.0025, 20_000) if full else (0.01, 1500)
    sim = simulation(
        spacing, box([-0.05, 0.0], [0.05, 0.1]), scheme=scheme, material=CAM_CLAY, gravity=[0.0, -GRAVITY],
        initial_stress={"type": "geostatic", "K0": 0.7},
        boundaries={"push": {"where": {"upper": [-0.045, None]},
                             "velocity": {"x": {"times": [0.0, 0.005, 0.02], "values": [0.0, 1.0, -0.5]}}}},
        contacts=[{"type": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.5, "damping": 0.1}],
        stages=[{"name": "push", "type": "dynamics", "duration": 1.0, "boundaries": ["push"],
                 "damping": {"viscous": 20.0}}],
    )  # fmt: skip
    sim.start()
    sim.time_step = _Unsteady(0.6 * spacing / P_SPEED)
    sim.prescribed_motions, sim.loads = sim.stages[0].prescribed_motions, sim.stages[0].loads
    worst, parts = 0.0, {}
    for step in range(1, steps + 1):
        sim.step()
        if step % 50 == 0:
            entries = sim.ledger.entries()
            other = "energy_residual", "exchange_dissipation"  # Cam-Clay does not exchange stress
            parts = {name: value for name, value in entries.items() if name not in other}
            unexplained = abs(entries["energy_residual"] - entries["integration_term"])
            worst = max(worst, unexplained / max(map(abs, parts.values())))
    least = min(map(abs, parts.values())) / max(map(abs, parts.values()))
    return [
        Figure("unexplained energy, / largest term", worst, at_most=1e-12),
        Figure("smallest term, / largest: no part of the ledger is idle", least, at_least=1e-9),
        Figure("neighbour rebuilds", sim.rebuild_count, at_least=2),
    ]


class _StressPower:
    """Adds up volume times stress : strain increment of all rows and links by the trapezoidal rule in time."""

    def __init__(self, sim):
        self.sim, self.work, self.largest = sim, 0.0, 0.0
        self._volumes = self._row_volumes()
        self._deform, self._internal_force = sim.scheme.deform, sim.scheme.internal_force
        sim.scheme.deform, sim.scheme.internal_force = self._deform_and_keep, self._add_force_and_power

    def _deform_and_keep(self, particles, bonds, *rest):
        self._deform(particles, bonds, *rest)
        self._stresses = [rows.stress.copy() for rows in bonds.carriers]  # turned to the end of the step
        self._strains = [block.strain_increment.copy() for block in bonds.blocks]  # before openings take of them

    def _row_volumes(self):
        """Ids of the rows' ends in one number, ascending, and the rows' volumes, of every block and the links."""
        found = []
        for rows in self.sim.bonds.carriers:
            keys, place = rows.layout.keys(rows, self.sim.bonds.pairs)
            ids = keys[place]
            found.append((ids[:, 0] << 32 | ids[:, 1], row_volumes(self.sim, rows)))
        return found

    def _add_force_and_power(self, particles, bonds, *rest):
        self._internal_force(particles, bonds, *rest)
        before, self._volumes = self._volumes, self._row_volumes()
        strains = [*self._strains]
        if bonds.links is not None:
            strains.append(self.sim.dt * link_rates(self.sim, self.sim.dt)[:, None])
        for rows, strain, stress, old, new in zip(
            bonds.carriers, strains, self._stresses, before, self._volumes, strict=True
        ):
            place = np.minimum(np.searchsorted(old[0], new[0]), len(old[0]) - 1)
            volume = np.where(old[0][place] == new[0], old[1][place], 0.0)  # a newborn row had none
            power = volume * contract(stress, strain) + new[1] * contract(rows.stress, strain)
            self.work += 0.5 * float(power.sum())
        self.largest = max(self.largest, abs(self.work))


def virtual_power(full=False, scheme=DEFAULT):
    """V4 (b) in one instant: power of force and of stress are opposite for any velocity and any stress.

    Points are displaced, two of them lie a tenth of a spacing apart, and tilts, where there are any, and moments of
    loads on the points' faces are at random.
    """
    figures = []
    for dimension in (2, 3):
        counts = [9, 7, 5][:dimension]
        sim = simulation(
            0.01, box([0.0] * dimension, [0.01 * n for n in counts]), scheme=scheme, dimension=dimension, jitter=0.2
        )
        sim.start()
        random = np.random.default_rng(0)
        p, tiny = sim.particles, 1e-20
        p.velocity[:] = random.normal(size=p.velocity.shape)
        p.position[1] = p.position[0] + 0.001 / np.sqrt(dimension)
        if "tilt" in p.fields:
            p.tilt[:] = 100.0 * random.normal(size=p.tilt.shape)
        sim.scheme.deform(p, sim.bonds, sim.halo, tiny, tiny)
        power = size = 0.0
        for block in sim.bonds.blocks:
            block.stress[:] = random.normal(size=block.stress.shape)
            rows = row_volumes(sim, block) * contract(block.stress, block.strain_increment) / tiny
            power, size = power + rows.sum(), size + np.abs(rows).sum()
        links = sim.bonds.links
        if links is not None:
            links.stress[:] = random.normal(size=links.stress.shape)
        moment = random.normal(size=(p.owned, dimension**2)) * 0.01**dimension
        sim.scheme.internal_force(p, sim.bonds, sim.halo, p.internal_force, moment)
        power -= (moment * owned(sim, "gradient")).sum()
        if links is not None:
            power += (row_volumes(sim, links) * links.stress[:, 0] * link_rates(sim)).sum()
        mismatch = abs((owned(sim, "internal_force") * owned(sim, "velocity")).sum() + power) / size
        figures.append(Figure(f"power of force and of stress, {dimension}D, relative", mismatch, at_most=1e-12))
    return figures


def _measured(sim, steps):
    """Mismatch of stress work and work of the internal force over `steps` steps, over the largest that it was."""
    power = _StressPower(sim)
    for _ in range(steps):
        sim.step()
    return abs(power.work - sim.ledger.entries()["internal_energy"]) / power.largest


def _affine_error(steps, scheme):
    """The mismatch while a block is squeezed, sheared and turned by a constant velocity gradient, to 30 % strain."""
    sim = simulation(
        0.01, box([0.0, 0.0], [0.08, 0.08]), scheme=scheme, jitter=0.2, material=CAM_CLAY,
        initial_stress={"type": "uniform", "components": {"xx": -1e4, "yy": -1e4, "zz": -1e4}},
        time_step={"fixed": 1.0 / steps},
    )  # fmt: skip
    sim.start()
    gradient = np.array([[-0.05, 0.3], [-0.2, -0.1]])
    sim.prescribed_motions = [ImposedVelocity(lambda x, dt: x @ gradient.T)]
    return _measured(sim, steps)


def _falling_error(material, fraction, end, cells, scheme):
    """The mismatch of a column on a rough floor that is let go, with a share of the default step."""
    sim = simulation(
        0.1 / cells, box([-0.05, 0.0], [0.05, 0.1]), scheme=scheme, material=material, gravity=[0.0, -GRAVITY],
        initial_stress={"type": "geostatic", "K0": 0.7},
        contacts=[{"type": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.5}],
    )  # fmt: skip
    sim.start()
    steps = int(np.ceil(end / (fraction * sim.dt)))
    sim.time_step.fixed = sim.dt = end / steps
    return _measured(sim, steps)


def stress_work(full=False, scheme=DEFAULT):
    """V4 (b): work of the stress against work of the internal force, without the viscosity of flowing points."""
    if isinstance(scheme, dict) and "regular" in scheme:
        scheme = scheme | {"regular": False}
    affine = [_affine_error(n, scheme) for n in (100, 200)]
    figures = [
        Figure("stress work, affine motion, 200 steps, relative", affine[-1]),
        Figure("its order in the step", order(affine), at_least=1.9),
    ]
    cells = 20 if full else 10
    start, half = (_falling_error(CAM_CLAY, f, 0.05, cells, scheme) for f in (1.0, 0.5))
    figures.append(Figure("stress work, start of a collapse (0.05 s), default step", start, at_most=1e-4))
    figures.append(Figure("the same with half of the step", half, at_most=1e-4))
    if full:
        whole = _falling_error(CAM_CLAY, 1.0, 0.2, 40, scheme)
        figures.append(Figure("stress work, most of a collapse (0.2 s), 40 rows, default step", whole, 1e-4))
        vibrating = _falling_error(ELASTIC, 1.0, 0.02, 20, scheme)
        figures.append(Figure("stress work, elastic column dropped (0.02 s), default step", vibrating))
    return figures
