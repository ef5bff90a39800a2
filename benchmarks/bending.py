"""What makes strips of points softer in bending than a beam: their schemes, horizons and numbers of points.

    python -m benchmarks bending [--quick]

A free strip in plane strain, eight thicknesses long, bears a load cos(2 pi x/L) per length over its section, which is
in balance by itself. Its compliance, load times displacement, is that of Timoshenko's beam, int M^2/E'I + V^2/kGA with
M = (1 + cos)/k^2 in closed form (k = 2 pi/L, shear factor 5/6); printed is by how much the strip is less stiff. A
section of n points has a second moment that is too small by 1/n^2, for points carry no bending of their own; the rest
is what the outermost rows see of the strain there.
"""

import numpy as np

from . import option_parser
from .library.verification_cases import OPTIONS
from .library.verification_cases.buckling import MODULUS
from .library.verification_cases.common import SHEAR, box, owned, simulation
from .library.verification_cases.motion import elastic_operator

LENGTH = 8.0  # thicknesses, of 1 m
KINDS = {
    "point_state, sharpened": (OPTIONS["point_state, sharpened"], 2.2),
    "the same, m = 3": (OPTIONS["point_state, sharpened"], 3.0),
    "point_state": ("point_state", 2.2),
    "bond_projected": ("bond_projected", 2.2),
    "standard": ("standard", 2.2),
}


def softness(points, scheme, m):
    """Compliance of a strip of `points` of thickness over that of the beam, less 1."""
    sim = simulation(1.0 / points, box([0.0, -0.5], [LENGTH, 0.5]), scheme=scheme, horizon=m)
    sim.start()
    n, wave = sim.particles.owned, 2.0 * np.pi / LENGTH
    load = np.zeros((n, 2))
    load[:, 1] = -np.cos(wave * (owned(sim, "position")[:, 0] - 0.5 * LENGTH)) / points**2
    load[:, 1] -= load[:, 1].mean()
    x, matrix = owned(sim, "position"), elastic_operator(sim)
    rigid = np.zeros((n, 2, 3))
    rigid[:, 0, 0] = rigid[:, 1, 1] = 1.0
    rigid[:, :, 2] = np.stack([-x[:, 1], x[:, 0] - 0.5 * LENGTH], axis=1)
    rigid = rigid.reshape(2 * n, 3)
    displacement = np.linalg.solve(matrix + SHEAR / n * rigid @ rigid.T, load.ravel())
    bent = 1.5 * LENGTH / wave**4 / (MODULUS / 12.0)
    sheared = 0.5 * LENGTH / wave**2 / (5.0 / 6.0 * SHEAR)
    return load.ravel() @ displacement / (bent + sheared) - 1.0


def main(words=None):
    """Print the table."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--quick", action="store_true", help="4 and 6 points of thickness, in place of 6, 8 and 12")
    counts = (4, 6) if parser.parse_args(words).quick else (6, 8, 12)
    print(f"| points of thickness | {' | '.join(str(n) for n in counts)} |\n|---{'|---' * len(counts)}|")
    for kind, (scheme, m) in KINDS.items():
        print(f"| {kind}, % | {' | '.join(f'{100.0 * softness(n, scheme, m):.2f}' for n in counts)} |", flush=True)
    print(f"| second moment of the points, % | {' | '.join(f'{100.0 / n**2:.2f}' for n in counts)} |")
