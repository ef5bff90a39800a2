"""V2 (b), V3, V9: free flight, stability, and bending."""

import numpy as np

from periporo.core.motion.energy import Ledger
from periporo.core.motion.stages import RelaxStage
from periporo.core.motion.timestep import apply_stiffness

from .common import (
    BULK,
    DEFAULT,
    DENSITY,
    P_SPEED,
    SHEAR,
    Figure,
    Recorder,
    box,
    order,
    owned,
    point_stress,
    simulation,
    strain_energy,
)

POISSON = (3.0 * BULK - 2.0 * SHEAR) / (2.0 * (3.0 * BULK + SHEAR))
YOUNG = 9.0 * BULK * SHEAR / (3.0 * BULK + SHEAR)


class _Centrifugal:
    """Force m w^2 x of a frame that turns about the origin."""

    def __init__(self, rate):
        self.rate = rate

    def add_force(self, p, time, dt):
        """Add to the external force."""
        p.external_force[: p.owned] += p.mass[:, None] * self.rate**2 * p.position[: p.owned]


def _angular_momentum(sim):
    x, v, m = owned(sim, "position"), owned(sim, "velocity"), sim.particles.mass
    if sim.particles.dimension == 2:
        return np.array([(m * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0])).sum()])
    return (m[:, None] * np.cross(x, v)).sum(axis=0)


def _disc_stress(position, radius, rate):
    """Stress rows of a long cylinder that turns about its axis (plane strain), Pa (Timoshenko & Goodier 1970)."""
    square = (position**2).sum(axis=1)
    scale = DENSITY * rate**2 * (3.0 - 2.0 * POISSON) / (8.0 * (1.0 - POISSON))
    radial = scale * (radius**2 - square)
    hoop = scale * (radius**2 - (1.0 + 2.0 * POISSON) / (3.0 - 2.0 * POISSON) * square)
    direction = position / np.sqrt(np.maximum(square, 1e-30))[:, None]
    xx = radial * direction[:, 0] ** 2 + hoop * direction[:, 1] ** 2
    yy = radial * direction[:, 1] ** 2 + hoop * direction[:, 0] ** 2
    xy = (radial - hoop) * direction[:, 0] * direction[:, 1]
    return np.stack([xx, yy, POISSON * (radial + hoop), xy], axis=1)


def spinning_disc(full=False, scheme=DEFAULT):
    """V2 (b): a disc, brought to equilibrium with its centrifugal force, is set free spinning.

    The stress is compared further than the horizon from the staircase that stands for the rim.
    """
    cells, turns = (20, 50) if full else (14, 0.5)
    spacing = 0.01
    radius = cells * spacing
    rate = 0.05 * P_SPEED / radius
    sim = simulation(spacing, {"type": "disc", "center": [0.0, 0.0], "radius": radius}, scheme=scheme)
    sim.start()
    RelaxStage(name="spin", loads=[_Centrifugal(rate)], tolerance=1e-6).run(sim)
    sim.loads = []
    x = owned(sim, "position")
    sim.particles.velocity[: len(x)] = rate * np.stack([-x[:, 1], x[:, 0]], axis=1)
    sim.evaluate_forces()
    sim.ledger = Ledger(sim.comm, sim.particles)
    kinetic, momentum, start = sim.ledger.kinetic(), _angular_momentum(sim)[0], sim.time
    drift, heat = 0.0, 0.0
    while (sim.time - start) * rate < 2.0 * np.pi * turns:
        sim.step()
        if sim.step_number % 50 == 0:
            drift = max(drift, abs(_angular_momentum(sim)[0] / momentum - 1.0))
            heat = max(heat, abs(sim.ledger.kinetic() / kinetic - 1.0))
    x = owned(sim, "position")
    exact = _disc_stress(x, np.sqrt(len(x) / np.pi) * spacing, rate)
    inner = (x**2).sum(axis=1) < (radius - 2.5 * spacing) ** 2
    error = np.linalg.norm((point_stress(sim) - exact)[inner]) / np.linalg.norm(exact[inner])
    return [
        Figure(f"angular momentum over {turns} turns, relative", drift, at_most=1e-12),
        Figure("kinetic energy, relative", heat, at_most=1e-4),
        Figure("interior stress, relative L2", error, at_most=0.02),
    ]


def tumbling_block(full=False, scheme=DEFAULT):
    """V2 (b) in 3D: an unstressed block thrown about an oblique axis; it vibrates, and momenta stay."""
    steps = 20_000 if full else 300
    sim = simulation(0.01, box([0, 0, 0], [0.08, 0.05, 0.03]), dimension=3, scheme=scheme, jitter=0.2)
    x = owned(sim, "position")
    sim.particles.velocity[:] = np.cross([20.0, -35.0, 30.0], x - x.mean(axis=0)) + [3.0, 1.0, -2.0]
    sim.start()
    first = _angular_momentum(sim)
    linear = sim.particles.mass @ owned(sim, "velocity")
    energy = sim.ledger.kinetic()
    turn, push, heat = 0.0, 0.0, 0.0
    for step in range(1, steps + 1):
        sim.step()
        if step % 50 == 0:
            turn = max(turn, np.abs(_angular_momentum(sim) - first).max() / np.abs(first).max())
            push = max(push, np.abs(sim.particles.mass @ owned(sim, "velocity") - linear).max() / np.abs(linear).max())
            heat = max(heat, abs((sim.ledger.kinetic() + strain_energy(sim)) / energy - 1.0))
    return [
        Figure(f"3D, angular momentum over {steps} steps, relative", turn, at_most=1e-12),
        Figure("3D, linear momentum, relative", push, at_most=1e-12),
        Figure("3D, kinetic and stored energy, relative", heat, at_most=1e-4),
    ]


def elastic_operator(sim):
    """Stiffness matrix (n d, n d) in N/m of an unstressed elastic scene, column by column through the kernels."""
    units = np.eye(sim.particles.owned * sim.particles.dimension)
    columns = [apply_stiffness(sim, unit.reshape(-1, sim.particles.dimension)).ravel() for unit in units]
    return np.stack(columns, axis=1)


INFLUENCES, HORIZONS, JITTERS = ("cubic", "conical", "gaussian", "constant"), (2.0, 2.2, 3.0), (0.0, 0.2)
ALL = [(i, m, j) for i in INFLUENCES for m in HORIZONS for j in JITTERS]
SOME = [(i, 2.2, j) for i in INFLUENCES for j in JITTERS] + [("cubic", 2.0, 0.2), ("cubic", 3.0, 0.2)]


def _off_the_grid(influence, horizon, jitter):
    """The combination, its horizon not equal to a distance of grid points if the influence jumps there.

    With `constant`, 2 or 3 spacings on a grid, rounding would decide whether pairs at the horizon belong, and
    each change of mind is a jump of the force that makes energy: no scheme can be conservative then.
    """
    return influence, horizon + (0.05 if influence == "constant" and jitter == 0.0 else 0.0), jitter


def _free_block(scheme, influence, horizon, jitter, counts=(14, 9)):
    shape = box([0.0] * len(counts), [0.01 * n for n in counts])
    keys = {"influence": influence, "horizon": horizon, "jitter": jitter, "dimension": len(counts)}
    return simulation(0.01, shape, scheme=scheme, **keys)


def spectrum(full=False, scheme=DEFAULT):
    """V3: the operator of a free block: symmetric, rigid modes only, and the time step against its limit."""
    asymmetry, rigid, softest, wastes = 0.0, 0.0, np.inf, []
    for combination in ALL if full else [("cubic", 2.2, 0.0), ("cubic", 2.2, 0.2), ("constant", 3.0, 0.2)]:
        sim = _free_block(scheme, *_off_the_grid(*combination))
        sim.start()
        chosen = sim.dt
        matrix = elastic_operator(sim)
        asymmetry = max(asymmetry, np.abs(matrix - matrix.T).max() / np.abs(matrix).max())
        root = np.sqrt(np.repeat(sim.particles.mass, 2))
        squares = np.sort(np.linalg.eigvals(matrix / np.outer(root, root)).real)
        softest = min(softest, squares[3] / squares[-1])
        rigid = max(rigid, np.abs(squares[:3]).max() / squares[-1])
        wastes.append(chosen * np.sqrt(squares[-1]) / 2.0)
    return [
        Figure("asymmetry of the stiffness, relative", asymmetry, at_most=1e-12),
        Figure("rigid modes, stiffness / largest", rigid, at_most=1e-12),
        Figure("softest other mode, stiffness / largest", softest, at_least=1e-5),
        Figure("time step / measured limit, smallest", min(wastes), at_least=0.7),
        Figure("time step / measured limit, largest", max(wastes), at_most=1.0),
    ]


def _excited(sim, steps, interval):
    """Largest of K/K0 - 1, and of |H/K0 - 1|, H the energy that velocity Verlet conserves in a linear system."""
    random = np.random.default_rng(0)
    sim.particles.velocity[:] = 1e-6 * random.normal(size=sim.particles.velocity.shape)
    sim.start()
    start, growth, drift = sim.ledger.kinetic(), 0.0, 0.0
    for step in range(1, steps + 1):
        sim.step()
        if step % interval == 0:
            kinetic = sim.ledger.kinetic()
            square = (sim.forces.total() ** 2).sum(axis=1) / sim.particles.mass
            shadow = kinetic + strain_energy(sim) - sim.dt**2 / 8.0 * square.sum()
            growth = max(growth, kinetic / start - 1.0)
            drift = max(drift, abs(shadow / start - 1.0))
            if not growth < 1e6:  # it will only be worse
                break
    return growth, drift


def stability(full=False, scheme=DEFAULT):
    """V3: free blocks with tiny random velocities; kinetic energy can never exceed its start if the step is stable."""
    steps = 100_000 if full else 2000
    everything = ALL if scheme == DEFAULT else SOME
    combinations = everything if full else [("cubic", 2.2, 0.2), ("gaussian", 3.0, 0.0), ("constant", 2.0, 0.0)]
    results = [_excited(_free_block(scheme, *_off_the_grid(*c)), steps, steps // 200) for c in combinations]
    growth, drift = np.array(results).max(axis=0)
    return [
        Figure(f"growth of kinetic energy in {steps} steps, worst of {len(results)}", growth, at_most=0.01),
        Figure("drift of kinetic and stored energy, relative", drift, at_most=0.01),
    ]


def _cantilever(cells, scheme, **keys):
    """A beam of length 1 m and height 0.1 m, clamped at x = 0, and its first Euler-Bernoulli mode at the points."""
    spacing = 0.1 / cells
    sim = simulation(
        spacing, box([-3 * spacing, 0.0], [1.0, 0.1]), scheme=scheme,
        boundaries={"wall": {"where": {"upper": [0.0, None]}, "fix": ["x", "y"]}},
        stages=[{"name": "swing", "type": "dynamics", "duration": 1.0, "boundaries": ["wall"]}], **keys,
    )  # fmt: skip
    root = 1.8751040687
    s = root * np.maximum(owned(sim, "position")[:, 0], 0.0)
    ratio = (np.cosh(root) + np.cos(root)) / (np.sinh(root) + np.sin(root))
    mode = np.cosh(s) - np.cos(s) - ratio * (np.sinh(s) - np.sin(s))
    slope = root * (np.sinh(s) + np.sin(s) - ratio * (np.cosh(s) - np.cos(s)))
    tall = owned(sim, "position")[:, 1] - 0.05
    tip = np.cosh(root) - np.cos(root) - ratio * (np.sinh(root) - np.sin(root))
    shape = np.stack([-slope * tall, mode], axis=1) / tip
    frequency = root**2 / (2.0 * np.pi) * np.sqrt(YOUNG / (1.0 - POISSON**2) / DENSITY * 0.1**2 / 12.0)
    return sim, shape, frequency


def cantilever(full=False, scheme=DEFAULT):
    """V9 (a): first frequency of a cantilever, L/h = 10, plane strain, against Timoshenko's beam."""
    figures, errors = [], []
    for cells in (8, 16) if full else (6, 9):
        sim, shape, frequency = _cantilever(cells, scheme)
        sim.particles.velocity[:] = 1e-4 * shape
        sim.start()
        sim.prescribed_motions = sim.stages[0].prescribed_motions
        amplitude = Recorder(lambda s, a=shape: (a * (s.particles.position - s.particles.initial_position)).sum())
        sim.observers.append(amplitude)
        while sim.time < (1.2 if full else 0.65) / frequency:
            sim.step()
        time, u = amplitude.columns()
        k = np.flatnonzero(np.sign(u[1:]) != np.sign(u[:-1]))
        crossing = time[k] - u[k] * (time[k + 1] - time[k]) / (u[k + 1] - u[k])
        measured = 0.5 * len(crossing) / crossing[-1]
        errors.append(abs(measured / (0.992 * frequency) - 1.0))
        target = 0.02 if cells == 16 else None
        figures.append(Figure(f"frequency, {cells} spacings over the height, relative", errors[-1], at_most=target))
    return [*figures, Figure("order in the spacing", order(errors, 2.0 if full else 1.5), at_least=1.3)]


def swinging_beam(full=False, scheme=DEFAULT, swing=0.3):
    """V9 (b): the same beam through large rotations: kinetic and stored energy stay.

    `swing` is the amplitude over the length that the starting velocity would give by linear theory.
    """
    periods = 20 if full else 1.25
    sim, shape, frequency = _cantilever(6, scheme)
    sim.particles.velocity[:] = swing * 2.0 * np.pi * frequency * shape
    sim.start()
    sim.prescribed_motions = sim.stages[0].prescribed_motions
    start, worst, tip = sim.ledger.kinetic(), 0.0, 0.0
    while sim.time < periods / frequency:
        sim.step()
        if sim.step_number % 50 == 0:
            worst = max(worst, abs((sim.ledger.kinetic() + strain_energy(sim)) / start - 1.0))
            tip = max(tip, np.abs(owned(sim, "position") - owned(sim, "initial_position"))[:, 1].max())
    return [
        Figure(f"kinetic and stored energy over {periods} periods, relative", worst, at_most=1e-3),
        Figure("largest deflection, lengths", tip),
    ]
