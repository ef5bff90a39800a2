"""Experimental laws of the collapse of granular columns between walls (plane) and of cylinders.

a is height over half-width (radius); run-out and height are over the half-width (radius) too.
"""

import numpy as np


def lube_run_out(a):
    """Plane: 1.2 a up to about 2, then 1.9 a^(2/3) (Lube et al. 2005)."""
    a = np.asarray(a, float)
    return np.where(a <= 2.0, 1.2 * a, 1.9 * a ** (2.0 / 3.0))


def lube_height(a):
    """Plane: all of it up to 1, then a^0.4 (Lube et al. 2005)."""
    a = np.asarray(a, float)
    return np.where(a <= 1.0, a, a**0.4)


def lube_time(height, gravity=9.81):
    """Time (s) in which the front of a column of `height` m comes to rest: 3.3 sqrt(H/g) (Lube et al. 2005)."""
    return 3.3 * np.sqrt(np.asarray(height, float) / gravity)


LAJEUNESSE_RUN_OUT = {1.0: 1.8, 2.0: 3.6, 4.0: 5.8}
"""Plane, by a (Lajeunesse et al. 2005, as quoted by others)."""


def lube_axisymmetric_run_out(a):
    """Cylinders: 1.24 a up to 1.7, then 1.6 sqrt(a) (Lube et al. 2004)."""
    a = np.asarray(a, float)
    return np.where(a < 1.7, 1.24 * a, 1.6 * np.sqrt(a))


def lube_axisymmetric_height(a):
    """Cylinders: all of it up to 1, then 0.88 a^(1/6) (Lube et al. 2004)."""
    a = np.asarray(a, float)
    return np.where(a <= 1.0, a, 0.88 * a ** (1.0 / 6.0))
