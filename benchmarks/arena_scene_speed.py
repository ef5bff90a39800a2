"""Time of Arena per row and update in the bond loop of a plane scene, one core.

    python -m benchmarks arena_scene_speed

A block of points is made to follow a uniform velocity gradient in steps of |strain increment| = 1e-5. Plastic: after
compression and shear by 5 %, and on; every row yields. Elastic: to and fro under 1 MPa in a preconsolidated soil.
The time is that of the material's part of the step, divided by the active rows; the best of many steps counts.
"""

import numpy as np
from mpi4py import MPI

from periporo.core.loads.boundary import Motion
from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

from . import option_parser

DT, STEP, STEPS, POINTS = 1e-6, 1e-5, 200, 30
LOADING = np.array([[-1.0, 0.0], [0.2, -0.2]]) / np.sqrt(1.06)  # strain of size 1
INVISCID = {"T1": 0.0, "T2": 0.0}
CASES = {
    "dry": ({"initial_saturation": 0.0, **INVISCID}, 1.2),
    "saturated": ({"initial_saturation": 1.0, **INVISCID}, 2.0),
    "partly saturated, S0 = 0.5": ({"initial_saturation": 0.5, **INVISCID}, 2.5),
    "dry, rate-dependent": ({"initial_saturation": 0.0}, None),
    "partly saturated, all parts": ({"do_damage": True, "do_variability": True}, None),
}


class UniformMotion(Motion):
    """Prescribes the velocity gradient `gradient` (1/s) of all points about the origin."""

    def __init__(self):
        self.gradient = np.zeros((2, 2))

    def apply(self, p, time, dt, closing_step):
        """Set all velocities."""
        p.velocity[: p.owned] = p.position[: p.owned] @ self.gradient.T


def started(parameters, pressure):
    """The simulation of a square block of points under `pressure` Pa, and its motion."""
    components = dict.fromkeys(("xx", "yy", "zz"), -pressure)
    scene = {
        "dimension": 2, "spacing": 1.0 / POINTS, "materials": {"sand": {"model": "arena", **parameters}},
        "bodies": [{"name": "block", "material": "sand",
                    "shape": {"type": "box", "lower": [-0.5, -0.5], "upper": [0.5, 0.5]}}],
        "stages": [{"name": "load", "type": "dynamics", "duration": 1.0}],
        "time_step": {"fixed": DT}, "initial_stress": {"type": "uniform", "components": components},
    }  # fmt: skip
    sim, motion = build(parse_scene(scene), MPI.COMM_SELF), UniformMotion()
    sim.start()
    sim.prescribed_motions = [motion]
    return sim, motion


def time_per_row(sim, motion, alternate):
    """Nanoseconds of the material per active row, and the least and largest share of rows that yield in a step."""
    block, times, yielding = sim.bonds.blocks[0], [], []
    for step in range(STEPS):
        motion.gradient = STEP / DT * LOADING * (-1 if alternate and step % 2 else 1)
        rebuilds, before = sim.rebuild_count, block.state[:, 0].copy()
        sim.timing.reset()
        sim.step()
        if sim.rebuild_count == rebuilds and step > 1:  # before, the velocities are those of another motion
            times.append(sim.timing.seconds["material"] / block.active.sum())
            yielding.append((before != block.state[:, 0])[block.active].mean())
    assert not block.state[:, 3].any(), "an update failed"
    return min(times) * 1e9, min(yielding), max(yielding)


def main(words=None):
    """Print one line per case with the targets."""
    option_parser(__name__, __doc__).parse_args(words)
    print(f"{'ns per row and update':32s} elastic (<= 100)   plastic")
    for name, (parameters, target) in CASES.items():
        sim, motion = started({"p0": 3e7, **parameters}, 1e6)
        elastic, _, most = time_per_row(sim, motion, alternate=True)
        assert most == 0.0, most
        sim, motion = started(parameters, 0.0)
        motion.gradient = 1e-3 / DT * LOADING
        for _ in range(50):
            sim.step()
        plastic, least, _ = time_per_row(sim, motion, alternate=False)
        assert least > 0.99, least
        goal = f"(<= {1000 * target:.0f})" if target else ""
        print(f"{name:32s} {elastic:7.0f}          {plastic:7.0f} {goal}")
