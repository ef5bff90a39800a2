"""From planes of symmetry and periodic axes of a scene to the images of its points."""

from periporo.core.points.particles import Particles
from periporo.core.ranks.images import Images


def build_images(scene, particles: Particles) -> Images | None:
    """The images that points of the scene have, None if there are none."""
    mirrors: dict[tuple[int, int], float] = {}
    periods: dict[int, tuple[float, float]] = {}
    for axis in range(scene.dimension):
        places = scene.symmetry.along(axis) if scene.symmetry else (None, None)
        mirrors |= {(axis, side): place for side, place in zip((1, -1), places, strict=True) if place is not None}
        lower, upper = scene.periodic.along(axis) if scene.periodic else (None, None)
        if lower is not None and upper is not None:
            periods[axis] = lower, upper
    return Images(particles, mirrors, periods) if mirrors or periods else None
