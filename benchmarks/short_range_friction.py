"""What the published short-range "friction" resists, against Coulomb's law: the mean over the normal force.

    python -m benchmarks short_range_friction

A point of 1 kg slides at 1 m/s along a substrate under its weight; the mean resistance follows from its loss of
kinetic energy. The last column is the largest slope that the substrate offers without any friction: what it takes
to pull a point out of the row.
"""

import numpy as np

from periporo.contact.rigid import RigidContact
from periporo.contact.short_range_published import ShortRangePublished
from periporo.contact.surfaces import Plane
from periporo.core.motion.integrator import drift, first_kick, second_kick
from periporo.core.points.forces import ForceChannels
from periporo.core.points.particles import Particles

from . import option_parser

SPACING, STIFFNESS, MASS, G, DT = 0.01, 4e6, 1.0, 9.81, 2e-5


def points(contact, position, velocity):
    """Free points of a scene that has nothing but `contact`."""
    p = Particles(2)
    forces = ForceChannels(p)
    forces.need("external")
    contact.attach(p, forces)
    n = len(position)
    owned = {f.name: np.zeros((n,) if f.columns is None else (n, f.columns), f.dtype) for f in p.migrating()}
    owned |= {"id": np.arange(n), "position": position, "reference_position": position, "velocity": velocity}
    owned |= {"mass": np.full(n, MASS), "volume": np.ones(n), "dilation": np.ones(n)}
    p.replace(owned, 0)
    p.jacobian[:] = 1.0
    return p, forces


def slide(contact, height, duration, speed, drag=0.0):
    """Move one point for `duration` s; its position and velocity."""
    p, forces = points(contact, np.array([[0.05, height]]), np.array([[speed, 0.0]]))
    for step in range(round(duration / DT)):
        first_kick(p, forces, DT)
        drift(p, forces, DT)
        for array in forces.arrays():
            array[:] = 0.0
        contact.add_force(p, (step + 1) * DT, DT)
        p.external_force[:] += p.mass[:, None] * np.array([0.0, -G]) - drag * p.velocity
        second_kick(p, forces, DT)
    return p.position[0], p.velocity[0]


def resistance(contact, start, speed=1.0, duration=0.5):
    """Mean resistance over the normal force of a point that starts at rest on the ground."""
    height = slide(contact, start, 0.2, 0.0, drag=100.0)[0][1]
    place, velocity = slide(contact, height, duration, speed)
    return (speed**2 - velocity[0] ** 2) / (2.0 * G * (place[0] - 0.05))


def largest_slope(contact, spacing):
    """Largest horizontal over vertical force on the way over one substrate spacing, without friction."""
    x = np.linspace(0.0, spacing, 401) + contact.origin[0] + 5.0 * spacing
    low, high = np.full(401, -0.5 * SPACING), np.full(401, SPACING)
    p, forces = points(contact, np.stack([x, high], axis=1), np.zeros((401, 2)))
    for _ in range(60):
        p.position[:, 1] = 0.5 * (low + high)
        p.contact_force[:] = 0.0
        contact.add_force(p, 0.0, 0.0)
        carries = p.contact_force[:, 1] > MASS * G
        low, high = np.where(carries, p.position[:, 1], low), np.where(carries, high, p.position[:, 1])
    return np.abs(p.contact_force[:, 0]).max() / (MASS * G)


def published(friction, spacing):
    """The published contact with the substrate spacing in m."""
    return ShortRangePublished([-0.1, -SPACING], [3.0, 0.0], spacing, spacing=SPACING, stiffness=STIFFNESS,
                               friction=friction, cutoff=0.8 * SPACING)  # fmt: skip


def main(words=None):
    """Print resistance and slope of both laws."""
    option_parser(__name__, __doc__).parse_args(words)
    print("law        friction  substrate  mean resistance/N  largest slope")
    for friction in (0.25, 0.5):
        floor = Plane([0.0, 0.0], [0.0, 1.0])
        law = RigidContact("0", floor, spacing=SPACING, skin=1.0, stiffness=STIFFNESS, friction=friction)
        print(f"Coulomb    {friction:8.2f}  {'plane':9s}  {resistance(law, 0.5 * SPACING, duration=0.15):17.4f}")
        for share in (0.1, 0.25, 0.5, 1.0):
            spacing = share * SPACING
            value = resistance(published(friction, spacing), 0.8 * SPACING)
            slope = largest_slope(published(0.0, spacing), spacing)
            print(f"published  {friction:8.2f}  {share:4.2f} dx    {value:17.4f} {slope:14.3f}")
