"""Forces on points, in channels that the energy ledger tells apart."""

import numpy as np

from periporo.core.points.particles import Field, Particles

WORK = ("internal", "external", "contact", "friction", "damping", "prescribed", "integration")
"""Columns of the point field `work` (J): force channels, constraints, and the time integrator's own term."""
FLOW_WORK = ("viscous_dissipation", "exchange_dissipation", "rearrangement_work")
"""Columns of the point field `flow_work` (J) of schemes that keep flowing points regular."""
PRESCRIBED, INTEGRATION = WORK.index("prescribed"), WORK.index("integration")


class ForceChannels:
    """The forces that a scene has, each an (n, d) point array of its own that the ledger can tell apart."""

    def __init__(self, particles: Particles):
        self.names: list[str] = []
        self.columns = np.empty(0, np.int64)  # of `work`, for each channel
        self._found: tuple[np.ndarray | None, tuple[np.ndarray, ...]] = None, ()  # ids of the points, and their arrays
        self._particles = particles
        particles.add_field(Field("work", len(WORK), "J", sent=False))
        particles.add_field(Field("previous_velocity", particles.dimension, "m/s", migrates=False, sent=False))

    def need(self, name: str) -> None:
        """Declare a channel of `WORK`; declaring it again changes nothing."""
        if name not in self.names:
            self.names.append(name)
            self.columns = np.array([WORK.index(n) for n in self.names], np.int64)
            self._found = None, ()
            self._particles.add_field(
                Field(f"{name}_force", self._particles.dimension, "N", migrates=False, sent=True)
            )

    def arrays(self) -> tuple[np.ndarray, ...]:
        """The (total, d) N array of each channel."""
        ids, arrays = self._found
        if ids is not self._particles.id:  # a rebuild makes all arrays anew
            arrays = tuple(getattr(self._particles, f"{n}_force") for n in self.names)
            self._found = self._particles.id, arrays
        return arrays

    def total(self) -> np.ndarray:
        """Sum of all channels on the owned points, (owned, d) N."""
        n = self._particles.owned
        return sum(a[:n] for a in self.arrays())  # type: ignore[return-value] # there is always a channel
