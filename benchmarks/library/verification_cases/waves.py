"""V5, W9: speed of pressure and shear waves, and of those in pores full of water."""

import numpy as np

from .common import BULK, DEFAULT, DENSITY, P_MODULUS, P_SPEED, S_SPEED, SHEAR, Figure, box, order, owned, simulation

LATTICE_ERROR = 0.0118  # of the phase speed at 20 spacings per wavelength: cubic influence, horizon 2.2 spacings


WATER, PORES = 2.2e9, 0.4  # bulk modulus of water, porosity


def phase_speed(cells, shear, scheme, safety=None, exact_time=False, speed=None, prepare=None, **keys):
    """Phase speed in m/s of a plane packet along x whose carrier is `cells` spacings long, in a free block.

    It is read in the middle of the block before anything arrives from its sides. Each Fourier component is a
    sum of a wave to the right and one to the left, so three equidistant samples of it obey
    a(t - s) + a(t + s) = 2 cos(omega s) a(t). Time steps are a fifth of what the wave takes for a spacing, or with
    `safety` what the program chooses; with `exact_time` their error is taken out, since velocity Verlet makes of a
    frequency omega (2/dt) asin(omega dt/2). `keys` of the input file may name another influence or horizon. A packet of
    another `speed` is made by prepare(sim, strain), which sets what else belongs to the strain of points at the start.
    """
    wavelength = 1.0
    spacing = wavelength / cells
    fastest = P_SPEED if speed is None else speed
    speed = S_SPEED if shear else fastest
    travel = 0.55 * wavelength * fastest / speed  # of the fastest wave, meanwhile
    half = 2.2 * wavelength + travel
    rows = 2 * int(np.ceil((travel + 3 * spacing) / spacing)) + 1
    sample = 0.25 * wavelength / speed
    steps = int(np.ceil(sample / (0.2 * spacing / fastest)))
    height = rows * spacing / 2.0
    choice = {"fixed": sample / steps} if safety is None else {"safety": safety}
    sim = simulation(spacing, box([-half, -height], [half, height]), scheme=scheme, time_step=choice, **keys)
    wave_number = 2.0 * np.pi / wavelength

    def strain(x):
        return 1e-7 * np.cos(wave_number * x) * np.exp(-((x / (0.55 * wavelength)) ** 2))

    def stress(position):
        e = strain(position[:, 0])
        zero = 0.0 * e
        lateral = (BULK - 2.0 / 3.0 * SHEAR) * e
        return np.stack([zero, zero, zero, SHEAR * e] if shear else [P_MODULUS * e, lateral, lateral, zero], axis=1)

    sim.bonds.initial_stress = stress
    sim.particles.velocity[:, 1 if shear else 0] = -speed * strain(sim.particles.position[:, 0])
    if prepare is not None:
        prepare(sim, strain(sim.particles.position[:, 0]))
    sim.start()
    steps = int(np.ceil((1.0 - 1e-9) * sample / sim.dt))
    sim.time_step.fixed = sim.dt = sample / steps
    amplitudes = []
    for sample in range(3):
        for _ in range(steps if sample else 0):
            sim.step()
        middle = np.abs(owned(sim, "initial_position")[:, 1]) < 0.1 * spacing
        x, v = owned(sim, "initial_position")[middle, 0], owned(sim, "velocity")[middle, 1 if shear else 0]
        amplitudes.append((v * np.exp(-1j * wave_number * x)).sum())
    cosine = ((amplitudes[0] + amplitudes[2]) / (2.0 * amplitudes[1])).real
    frequency = np.arccos(cosine) / (steps * sim.dt)
    if exact_time:
        frequency = 2.0 / sim.dt * np.sin(0.5 * sim.dt * frequency)
    return frequency / wave_number


def wave_speed(full=False, scheme=DEFAULT):
    """V5: phase speed of P and S packets at 20 spacings per wavelength, and its order."""
    figures = []
    for name, shear, exact in (("P", False, P_SPEED), ("S", True, S_SPEED)):
        cells = (10, 20, 40) if full else (10, 20)
        errors = [abs(phase_speed(n, shear, scheme, exact_time=True) / exact - 1.0) for n in cells]
        figures.append(Figure(f"phase error of {name} waves, 20 spacings", errors[1], at_most=0.013))
        overall = order((errors[0], errors[-1]), cells[-1] / cells[0])
        figures.append(Figure(f"order of {name} waves, {cells[0]} to {cells[-1]} spacings", overall, at_least=1.9))
    return figures


def undrained_wave(full=False, scheme=DEFAULT):
    """W9: phase speed of P packets with water that cannot leave, ((K + K_w/phi + 4/3 mu)/rho)^1/2, at 20 spacings."""

    def squeeze(sim, strain):
        p = sim.particles
        p.pore_pressure[:] = -WATER / PORES * strain
        p.water_content[:] = PORES * p.volume * (1.0 - strain / PORES)

    exact = np.sqrt((P_MODULUS + WATER / PORES) / (DENSITY + 1000.0 * PORES))
    water = {"suction": 0, "drainage": "undrained", "porosity": PORES, "bulk_modulus": WATER}
    found = phase_speed(20, False, scheme, exact_time=True, speed=exact, prepare=squeeze, pore_water=water)
    return [Figure("phase error of undrained P waves, 20 spacings", abs(found / exact - 1.0), at_most=0.01)]
