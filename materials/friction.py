"""Angles of friction that a cone in the space of stress gives: one slope is another angle in every test."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class FrictionAngles:
    """Degrees in triaxial compression, triaxial extension and plane strain; None where no shear makes it fail."""

    compression: float | None
    extension: float | None
    plane_strain: float | None

    def __str__(self) -> str:
        names = ("compression", "extension", "plane strain")
        values = (self.compression, self.extension, self.plane_strain)
        return ", ".join(f"{shown(v)} in {n}" for n, v in zip(names, values, strict=True))


def shown(angle: float | None) -> str:
    """An angle as text."""
    return "no limit" if angle is None else f"{angle:.1f} degrees"


def angles_of_cone(eta: float, dilation: float = 0.0) -> FrictionAngles:
    """Angles of the cone sqrt(J2) = eta |p| that flows by the potential sqrt(J2) + `dilation` p.

    In triaxial tests sin(phi) = 3 M/(6 +- M) with M = sqrt(3) eta = q/|p|. In plane strain the stress out of plane
    is that of flow in the plane (`periporo.materials.drucker_prager`), sin(phi) = eta sqrt(1 - dilation^2/3)/(1 - eta
    dilation/3), which is eta without dilation; from a dilation of sqrt(3) on no flow stays in the plane.
    """
    slope = math.sqrt(3.0) * eta
    in_plane, against = 1.0 - dilation**2 / 3.0, 1.0 - eta * dilation / 3.0
    flow = math.sqrt(in_plane) / against if in_plane > 0.0 and against > 0.0 else math.inf
    return FrictionAngles(
        compression=_angle(3.0 * slope / (6.0 + slope)),
        extension=_angle(3.0 * slope / (6.0 - slope) if slope < 6.0 else math.inf),
        plane_strain=_angle(eta * flow),
    )


def _angle(sine: float) -> float | None:
    return math.degrees(math.asin(sine)) if sine < 1.0 else None
