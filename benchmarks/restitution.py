"""Restitution of two equal bars that meet head on, and what limits it.

    python -m benchmarks restitution

By St Venant's theory bars of one length exchange their velocities: 1. Their front is a jump, which no lattice carries
without a train of short waves behind it, and what these hold when the bars part is lost to the motion. Four columns
tell the contact's part from this one:

- the bars in contact of type `bodies`;
- the same points as one body, without any contact: the best that its halves have at any time, were they cut there;
- two chains of equal masses and springs, of which that between them cannot pull, at the same share of their limit;
- the share of a bar's energy of vibration, after the impact, in waves longer than 10 spacings, of 5 to 10, and shorter:
  what a contact that is too soft or too stiff leaves would be the longest.

The last column is what the ledger has as energy of the contact at the end, over that of the motion at the start.
"""

import numpy as np
from mpi4py import MPI

from periporo import Simulation

from . import option_parser

LENGTH, SPEED, DENSITY, MODULUS = 0.4, 0.1, 1760.0, 7.5e6
SOIL = {"model": "elastic", "density": DENSITY, "bulk_modulus": MODULUS / 3.0, "shear_modulus": MODULUS / 2.0}
WAVE = np.sqrt(MODULUS / DENSITY)  # Poisson's ratio is 0
PASSAGE = LENGTH / WAVE  # s
PARTED = 2.05  # passages
OBSERVED = 6.0  # passages in which vibration is looked at


def bars(points: int, safety: float, gap: float, contacts: list) -> Simulation:
    """Two bars of `points` by 2 points, the first of which moves, at rest for the rest; `gap` in spacings."""
    h = LENGTH / points
    boxes = [[0.0, LENGTH], [LENGTH + gap * h, 2.0 * LENGTH + gap * h]]
    bodies = [
        {"name": name, "material": "soil", "shape": {"type": "box", "lower": [low, 0.0], "upper": [high, 2.0 * h]},
         "velocity": [velocity, 0.0]}
        for name, (low, high), velocity in zip("ab", boxes, (SPEED, 0.0), strict=True)
    ]  # fmt: skip
    duration = (PARTED + OBSERVED) * PASSAGE + gap * h / SPEED
    return Simulation.from_scene({
        "dimension": 2, "spacing": h, "materials": {"soil": SOIL}, "bodies": bodies, "contacts": contacts,
        "time_step": {"safety": safety}, "stages": [{"name": "go", "type": "dynamics", "duration": duration}],
    }, MPI.COMM_SELF)  # fmt: skip


def ratio(p) -> float:
    """Velocity with which the second bar flees the first, over that of the approach."""
    first, second = (p.velocity[p.body == b, 0].mean() for b in (0, 1))
    return float(second - first) / SPEED


def in_contact(points: int, safety: float) -> tuple[float, np.ndarray, float]:
    """Restitution, energy of the first bar's waves by number of half waves, and energy of the contact."""
    gap = 0.3
    sim = bars(points, safety, gap, [{"type": "bodies", "between": "all", "friction": 0.0}])
    begin, number, looks = gap * LENGTH / points / SPEED + PARTED * PASSAGE, np.arange(1, points), []

    def look(sim):
        p = sim.particles
        if sim.time > begin:
            mine = p.body == 0
            shape = np.cos(np.pi * np.outer(number, p.initial_position[mine, 0] / LENGTH))
            looks.append((2.0 * (shape @ p.velocity[mine, 0]) / mine.sum()) ** 2)

    sim.call_every(1, look)
    sim.run()
    entries = sim.ledger.entries()
    return ratio(sim.particles), np.mean(looks, axis=0), entries["contact_energy"] / sim.ledger.initial_kinetic


def in_one_piece(points: int, safety: float) -> float:
    """The largest ratio that the halves of one body have at any time."""
    sim, seen = bars(points, safety, 0.0, []), []
    sim.call_every(1, lambda sim: seen.append(ratio(sim.particles)) if sim.time < 2.5 * PASSAGE else None)
    sim.run()
    return max(seen)


def chains(points: int, safety: float) -> float:
    """Restitution of two chains of unit masses and springs by the same integrator."""
    x, v, dt = np.zeros(2 * points), np.zeros(2 * points), safety
    v[:points], force = 1.0, np.zeros(2 * points)
    for _ in range(int(2.5 * points / dt)):
        v += 0.5 * dt * force
        x += dt * v
        pull = np.diff(x)
        pull[points - 1] = min(pull[points - 1], 0.0)
        force = np.concatenate([pull, [0.0]]) - np.concatenate([[0.0], pull])
        v += 0.5 * dt * force
    return v[points:].mean() - v[:points].mean()


def main(words=None):
    option_parser(__name__, __doc__).parse_args(words)
    print("| points | safety | contact | one piece | chains | waves > 10, 5 to 10, < 5 spacings | contact energy |")
    print("|---|---|---|---|---|---|---|")
    for points in (20, 40):
        for safety in (0.4, 0.8):
            restitution, energy, stored = in_contact(points, safety)
            length = 2.0 * points / np.arange(1, points)
            parts = [energy[length > 10], energy[(length > 5) & (length <= 10)], energy[length <= 5]]
            shares = ", ".join(f"{part.sum() / energy.sum():.2f}" for part in parts)
            print(f"| {points} | {safety} | {restitution:.3f} | {in_one_piece(points, safety):.3f} | "
                  f"{chains(points, safety):.3f} | {shares} | {stored:.0e} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
