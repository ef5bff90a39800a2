"""Contact between obstacles, of which at least one is free: a few places of one against the surface of the other.

Each place is a ball: the whole of a disc or sphere, or a corner of a box. What acts on it is what acts on a point, see
`periporo.contact.rigid`: a spring along the normal, and one along the surface cut to Coulomb's limit; both are damped.
All ranks compute the same, since obstacles are few.
"""

import numpy as np

from periporo.contact.free import Free
from periporo.contact.motion import velocity_between
from periporo.contact.rigid import RigidContact
from periporo.core.numerics.tensors import moments


class Touching:
    """All contacts between obstacles; springs (m) are kept by the names of both."""

    def __init__(self) -> None:
        self._springs: dict[str, np.ndarray] = {}

    def close(self, contacts: list, time: float, dt: float) -> None:
        """End a step of `dt` s of the free ones among the contacts, with what points and other obstacles do to them."""
        present = [c for c in contacts if isinstance(c, RigidContact)]
        total = {c.name: c.reaction.loads.sum(axis=0) for c in present if c.feelers and c.reaction}
        for own in present:
            for other in present:
                if own.name in total and other is not own:
                    self._press(own, other, dt, total)
        for own in present:
            if isinstance(own.motion, Free):
                load, d = total[own.name], len(own.motion.centre)
                own.motion.close(load[:d], load[d:], time, dt)

    def memory(self) -> dict:
        """What a checkpoint keeps."""
        return {name: spring.tolist() for name, spring in self._springs.items()}

    def recall(self, memory: dict) -> None:
        """Go on from there."""
        self._springs = {name: np.array(spring) for name, spring in memory.items()}

    def _press(self, own, other, dt, total):
        """Add what the feelers of one obstacle meet at another, to both if the other is free, too."""
        feelers, key = own.feelers, f"{own.name}/{other.name}"
        centre = own.pose.left(feelers.places)
        gap, normal = other.gap(centre)
        touches = gap < feelers.radius
        if not touches.any():
            self._springs.pop(key, None)
            return
        overlap, normal = (feelers.radius - gap)[touches], normal[touches]
        place = centre[touches] - feelers.radius * normal
        slip = velocity_between(own.pose_before, own.pose, dt, place)
        if other.pose is not None:
            slip -= velocity_between(other.pose_before, other.pose, dt, place)
        approach = (slip * normal).sum(axis=1)
        k = feelers.stiffness
        viscous = 2.0 * max(own.damping, other.damping) * np.sqrt(k * feelers.mass)
        pressure = np.maximum(k * overlap - viscous * approach, 0.0)
        slip -= approach[:, None] * normal
        spring = self._springs.get(key, np.zeros_like(centre))
        spring[~touches] = 0.0
        stretched = spring[touches] + dt * slip
        stretched -= (stretched * normal).sum(axis=1)[:, None] * normal  # the surface may have turned
        drag = k * stretched + viscous * slip
        size = np.sqrt((drag**2).sum(axis=1))
        limit = np.minimum(own.friction_at(place), other.friction_at(place)) * pressure
        slides = size > limit
        drag[slides] *= (limit[slides] / size[slides])[:, None]
        stretched[slides] = drag[slides] / k
        spring[touches] = stretched
        self._springs[key] = spring
        force = pressure[:, None] * normal - drag
        for body, sign in ((own, 1.0), (other, -1.0)):
            if body.name in total:
                arm = place - body.pose.reference
                total[body.name] += sign * np.concatenate([force, moments(arm, force)], axis=1).sum(axis=0)
