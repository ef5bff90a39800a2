"""Forces on points, in channels that the energy ledger tells apart."""

import functools

import numpy as np

from periporo.core.numerics import vectors
from periporo.core.numerics.jit import kernel
from periporo.core.points.particles import Field, Particles

WORK = ("internal", "external", "contact", "friction", "damping", "prescribed", "inertia", "integration")
"""Columns of the point field `work` (J): force channels, constraints, and the time integrator's own term."""
FLOW_WORK = ("viscous_dissipation", "exchange_dissipation", "rearrangement_work")
"""Columns of the point field `flow_work` (J) of schemes that keep flowing points regular."""
INTERNAL, CONTACT, FRICTION, PRESCRIBED, INTEGRATION = (
    WORK.index(name) for name in ("internal", "contact", "friction", "prescribed", "integration")
)


class ForceChannels:
    """The forces that a scene has, each an (n, d) point array of its own that the ledger can tell apart."""

    def __init__(self, particles: Particles):
        self.names: list[str] = []
        self.columns = np.empty(0, np.int64)  # of `work`, for each channel
        self._ids: np.ndarray | None = None  # of the points that these arrays are of
        self._arrays: tuple[np.ndarray, ...] = ()
        self._moments: tuple[np.ndarray, ...] = ()
        self._loads: list[np.ndarray] = []  # all of these that the internal force is not among
        self.on_faces: list[str] = []  # channels whose loads act on faces
        self._face_columns: tuple[int, ...] = ()  # of `work`, for each of these
        self._particles = particles
        particles.add_field(Field("work", len(WORK), "J", sent=False))
        particles.add_field(Field("previous_velocity", particles.dimension, "m/s", migrates=False, sent=False))

    def need(self, name: str, on_faces: bool = False) -> None:
        """Declare a channel of `WORK`, with moments if loads act `on_faces`; declaring it again changes nothing."""
        if on_faces and name not in self.on_faces:
            self.on_faces.append(name)
            self._face_columns += (WORK.index(name),)
            self._ids = None
            # kept from one step to the next, which begins with these loads
            self._particles.add_field(Field(f"{name}_moment", self._particles.dimension**2, "N m", sent=False))
        if name not in self.names:
            self.names.append(name)
            self.columns = np.array([WORK.index(n) for n in self.names], np.int64)
            self._ids = None
            self._particles.add_field(
                Field(f"{name}_force", self._particles.dimension, "N", migrates=False, sent=True)
            )

    def arrays(self) -> tuple[np.ndarray, ...]:
        """The (total, d) N array of each channel."""
        if self._ids is not self._particles.id:  # a rebuild makes all arrays anew
            self._find()
        return self._arrays

    def moments(self) -> tuple[np.ndarray, ...]:
        """The (owned, d^2) N m array of each channel with loads on faces."""
        self.arrays()
        return self._moments

    def _find(self):
        p = self._particles
        self._arrays = tuple(getattr(p, f"{name}_force") for name in self.names)
        self._moments = tuple(getattr(p, f"{name}_moment") for name in self.on_faces)
        loads = [array for name, array in zip(self.names, self._arrays, strict=True) if name != "internal"]
        self._loads = [*loads, *self._moments]
        self._ids = p.id

    def forget(self) -> None:
        """Hold no arrays, which are about to be replaced."""
        self._ids, self._arrays, self._moments, self._loads = None, (), (), []

    def moment(self) -> np.ndarray | None:
        """Sum of all moments of loads on faces, (awake, d^2) N m, or None if no channel has such loads."""
        n = self._particles.awake
        return functools.reduce(np.add, (moment[:n] for moment in self.moments())) if self.on_faces else None

    def clear(self) -> None:
        """No load any more; the internal force stays."""
        self.arrays()
        for load in self._loads:
            load.fill(0.0)

    def book_moments(self, dt: float) -> None:
        """Give channels the work of their moments in `dt` s, at the points' velocity gradients."""
        p = self._particles
        if self.on_faces:
            square = p.dim * p.dimension  # as long as a row
            _book_moments(p.awake, dt, self.moments(), p.gradient, p.work, self._face_columns, INTERNAL, square)

    def total(self) -> np.ndarray:
        """Sum of all channels on the owned points, (owned, d) N."""
        n = self._particles.owned
        return sum(a[:n] for a in self.arrays())  # type: ignore[return-value] # there is always a channel


@kernel
def _book_moments(awake, dt, moments, gradient, work, columns, internal, square):
    for i in range(awake):
        rate = vectors.row(gradient, i, square) * dt
        for c, moment in enumerate(moments):
            done = vectors.dot(vectors.row(moment, i, square), rate)
            if done != 0.0:  # most points bear none, or NaN
                work[i, columns[c]] += done
                work[i, internal] -= done
