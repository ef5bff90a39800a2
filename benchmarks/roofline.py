"""Each kernel of an elastic step against this machine.

    python -m benchmarks roofline [--side 40] [--dimension 2]

Measured in the same run: the rate of fused multiply-adds in vectors, and the rates at which one core streams memory
that lies in its second cache and in main memory. Per point and kernel: flops and bytes (counted from the source: what a
pass reads and writes for each of its items, wherever it lies), time, and the shares of both limits. A kernel near
neither is bound by its instructions: looking up the two ends of a pair and adding to them, one by one.
"""

import time

import numpy as np
from numba import njit

from periporo.core.correspondence import flux, kinematics, moments, sharpening
from periporo.core.correspondence.links import close_flux, strain_links

from . import option_parser
from .library.blocks import block

# flops per pair or point, (2D, 3D): additions and multiplications, divisions and roots as one each
FLOPS = {
    "neighbourhoods": (74, 128), "close points": (60, 190), "neighbours' gradients": (20, 40), "strain": (110, 360),
    "material": (16, 20), "links": (98, 171), "close flux": (24, 70), "force": (30, 53),
}  # fmt: skip


@njit(fastmath={"contract"})
def multiply_add(x, a, b, rounds):
    """Multiply-adds on an array (n,) that stays in registers and the first cache."""
    for _ in range(rounds):
        for k in range(x.shape[0]):  # the eight multiply-adds of an element wait for each other, elements do not
            y = (((x[k] * a + b) * a + b) * a + b) * a + b
            x[k] = (((y * a + b) * a + b) * a + b) * a + b


@njit(fastmath=True)
def triad(a, b, c, rounds):
    """a = b + c / 2, which streams three arrays (n,)."""
    for _ in range(rounds):
        for k in range(a.shape[0]):
            a[k] = b[k] + 0.5 * c[k]


def quickest(function, repeats: int = 7) -> float:
    """Least time of a call, s, after a first one that is not counted."""
    function()
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        function()
        times.append(time.perf_counter() - began)
    return min(times)


def machine() -> tuple[float, float, float]:
    """Flops per second; bytes per second from the second cache and from main memory."""
    x = np.ones(2048)
    flops = 2 * 8 * 1000 * len(x) / quickest(lambda: multiply_add(x, 0.999, 0.001, 1000))
    rates = []
    for size, rounds in ((20_000, 400), (8_000_000, 1)):
        a, b, c = np.zeros(size), np.ones(size), np.ones(size)
        rates.append(32 * size * rounds / quickest(lambda a=a, b=b, c=c, rounds=rounds: triad(a, b, c, rounds)))
    return flops, *rates


def kernels(sim) -> dict:
    """Name -> (function, items that it goes through, bytes per item)."""
    p, pairs, law, scheme, links = sim.particles, sim.bonds.pairs, sim.bonds.blocks[0], sim.scheme, sim.bonds.links
    force, pull, asks = np.zeros_like(p.position), np.zeros(len(pairs.first)), np.ones(p.total, np.bool_)
    d, c, m = p.dimension, p.components, p.dimension**2
    shape = d * (d + 1) // 2
    ends, n, points = 8, len(pairs.first), p.owned
    near = int((pairs.weight > 0.0).sum())
    return {
        "neighbourhoods": (
            lambda: moments._sum_moments(
                pairs.first, pairs.second, pairs.weight, pairs.count, p.position, p.velocity, p.volume, p.widths(),
                scheme.horizon, scheme.table, p.sums, p.dim),
            n, ends + 16 + 2 * 8 * (2 * d + 1) + 4 * 8 * (1 + shape + m)),
        "close points": (
            lambda: moments._close_points(
                points, sim.dt, scheme.horizon, p.volume, pairs.count, p.sums, p.dilation, p.share, p.shape_inverse,
                p.gradient, p.jacobian, p.dim),
            points, 8 * (1 + shape + m + 3 + 3 + shape + m + 1)),
        "neighbours' gradients": (
            lambda: sharpening._sum_differences(
                pairs.first, pairs.second, pairs.weight, p.volume, p.share, p.gradient, asks, p.sharp, p.dim),
            near, ends + 8 + 2 * 8 * 3 + 6 * 8 * m),
        "strain": (
            lambda: kinematics.strain_rows(
                law.first, law.active, p.sharp, sim.dt, law.stress, law.strain_increment, law.state,
                law.tensor_columns, law.spin, law.peak, p.dim),
            points, 5 + 8 * m + 8 * 4 * c),
        "material": (
            lambda: law.material.compute_stress(law.stress, law.strain_increment, law.state, sim.dt),
            points, 8 * 3 * c),
        "links": (
            lambda: strain_links(
                pairs.first, pairs.second, pairs.weight, p.position, p.velocity, p.gradient, p.link, p.seen,
                scheme.closest, sim.dt, links.active, links.stress, pull, p.flux, p.dim),
            near, ends + 8 + 1 + 24 + 2 * 8 * (2 * d + m + 4 + m) + 8 * 8 * m),
        "close flux": (
            lambda: close_flux(
                law.first, law.active, law.total_stress, p.volume, p.share, p.shape_inverse, p.flux, p.dim),
            points, 8 * (c + 1 + 3 + shape + 2 * m)),
        "force": (
            lambda: flux.add_flux_force(p, pairs, force, pull),
            near, ends + 16 + 2 * 8 * (d + 1 + m) + 4 * 8 * d),
    }  # fmt: skip


def main(words=None):
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--side", type=int, default=40, help="points along an edge of the block")
    parser.add_argument("--dimension", type=int, choices=(2, 3), default=2)
    arguments = parser.parse_args(words)
    flops, cache, memory = machine()
    sim = block(arguments.dimension, arguments.side, "elastic")
    for _ in range(3):
        sim.step()
    points = sim.particles.owned
    print(f"one core: {flops / 1e9:.1f} Gflop/s, {cache / 1e9:.1f} GB/s from the second cache, "
          f"{memory / 1e9:.1f} GB/s from memory; {points} points\n")  # fmt: skip
    print("| kernel | flops | bytes | ns | Gflop/s | of the peak | GB/s | of the second cache |\n" + "|---" * 8 + "|")
    total = 0.0
    for name, (function, items, size) in kernels(sim).items():
        each = items / points
        seconds = quickest(function) / points
        work, moved = FLOPS[name][arguments.dimension - 2] * each, size * each
        total += seconds
        print(f"| {name} | {work:.0f} | {moved:.0f} | {seconds * 1e9:.1f} | {work / seconds / 1e9:.1f} | "
              f"{100 * work / seconds / flops:.0f} % | {moved / seconds / 1e9:.0f} | "
              f"{100 * moved / seconds / cache:.0f} % |")  # fmt: skip
    print(f"| all | | | {total * 1e9:.1f} | | | | |")
