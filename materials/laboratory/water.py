"""Water in the pores of a specimen: full or partly so, at a prescribed pressure or shut in.

The law sees effective stress, sigma_bar = sigma + S p I, or another factor of Bishop's than S, with the pore pressure
p (compression positive, suction is -p); pressure and saturation follow as in a scene (`periporo.core.water`), from the
specimen's volume by its logarithmic strain.
"""

import numpy as np

from periporo.core.water.bishop import pore_stress
from periporo.core.water.content import fill_content, fill_pressure, porosities
from periporo.core.water.pore_water import bonding_variable
from periporo.core.water.retention import Retention, packed, saturations


class SpecimenWater:
    """Water of a specimen that had the volume 1 m^3 at the start.

    `drained` water has the `pressure` Pa that is set; after `shut` it keeps its content, and pressure follows the
    volume, by the `bulk_modulus` Pa of the water and the retention `curve`. `factors` (1, 3) is Bishop's
    (`periporo.core.water.bishop`).
    """

    def __init__(self, porosity: float, curve: Retention, factors: np.ndarray, bulk_modulus: float, pressure: float):
        self.pressure = float(pressure)
        self.drained = True
        self._initial = np.array([float(porosity)])
        self._curves, self._factors = packed([curve]), factors
        self._bulk = float(bulk_modulus)
        self._content = np.zeros(1)

    def shut(self, volumetric: float) -> None:
        """Keep the water that is there at the `volumetric` strain (tension positive)."""
        known = self._known(np.exp(np.array([volumetric])))
        fill_content(*known, np.array([self.pressure]), np.empty(1), self._content)
        self.drained = False

    def open(self, pressure: float) -> None:
        """Let water in and out at a `pressure` Pa."""
        self.drained, self.pressure = True, float(pressure)

    def at(self, volumetric: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pressure (n,) Pa and saturation (n,) at volumetric strains (n,), tension positive."""
        dilation = np.exp(volumetric)
        n = len(dilation)
        saturation, pressure = np.empty(n), np.full(n, self.pressure)
        if self.drained:
            porosity = porosities(self._initial, dilation)
            saturation = saturations(self._curves, np.zeros(n, np.int64), -pressure, porosity, dilation)
        else:
            content = np.full(n, self._content[0])
            fill_pressure(*self._known(dilation), content, saturation, pressure)
        return pressure, saturation

    def pore_stress(self, volumetric: np.ndarray) -> np.ndarray:
        """What the water adds to the laws' normal stress, -chi p, (n,) Pa at volumetric strains (n,)."""
        pressure, saturation = self.at(volumetric)
        return pore_stress(self._factors, np.zeros(len(pressure), np.int64), pressure, saturation)

    def bonding(self, volumetric: float) -> float:
        """The bonding variable xi of the suction."""
        pressure, saturation = self.at(np.array([volumetric]))
        return float(bonding_variable(np.maximum(-pressure, 0.0), saturation)[0])

    def _known(self, dilation: np.ndarray) -> tuple:
        """What the kernels of `core.water.content` ask for first: n points of one material and of unit volume."""
        n = len(dilation)
        return n, np.zeros(n, np.int64), self._initial, np.ones(n), dilation, self._bulk, self._curves
