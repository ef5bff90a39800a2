"""Points of interest, whose motion is recorded with the histories."""

import numpy as np

_EQUALLY = 1.0 + 1e-9  # times the smallest squared distance: as near, but for rounding


class Probes:
    """The points that were nearest to `places` (k, d) m at the start; of equally near ones the lowest id.

    Attribute `units` (history name -> unit) declares displacement and velocity of each, `point_0_displacement_x`, ...,
    and where soil is wet `point_0_pore_pressure`.
    """

    def __init__(self, places, particles, comm):
        self.comm = comm
        self.ids = [_nearest(np.array(place), particles, comm) for place in places]
        axes = "xyz"[: particles.dimension]
        self.units = {
            f"point_{k}_{quantity}_{axis}": unit
            for k in range(len(self.ids))
            for quantity, unit in (("displacement", "m"), ("velocity", "m/s"))
            for axis in axes
        }
        if "pore_pressure" in particles.fields:
            self.units |= {f"point_{k}_pore_pressure": "Pa" for k in range(len(self.ids))}

    def entries(self, p) -> dict[str, float]:
        """What `units` names of each probe, NaN for one that is gone; all ranks take part."""
        if not self.ids:
            return {}
        d, wet = p.dimension, "pore_pressure" in p.fields
        mine, held = np.zeros((len(self.ids), 2 * d + wet)), np.zeros(len(self.ids))
        for k, chosen in enumerate(self.ids):
            for i in np.flatnonzero(p.id[: p.owned] == chosen):
                pressure = [p.pore_pressure[i]] if wet else []
                mine[k], held[k] = (*(p.position[i] - p.initial_position[i]), *p.velocity[i], *pressure), 1.0
        values, held = self.comm.allreduce(mine), self.comm.allreduce(held)  # one rank owns a point, others add zero
        values[held == 0.0] = np.nan
        motion, pressures = values[:, : 2 * d].ravel().tolist(), values[:, 2 * d :].ravel().tolist()
        return dict(zip(self.units, motion + pressures, strict=True))


def _nearest(place, p, comm) -> int:
    """Id of the point whose initial position is nearest to `place` (d,)."""
    squares = ((p.initial_position[: p.owned] - place) ** 2).sum(axis=1)
    near = np.flatnonzero(squares <= squares.min(initial=np.inf) * _EQUALLY)
    found = [entry for rank in comm.allgather(list(zip(squares[near], p.id[near], strict=True))) for entry in rank]
    smallest = min(square for square, _ in found)
    return int(min(number for square, number in found if square <= smallest * _EQUALLY))
