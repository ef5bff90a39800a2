"""W12: rain brings a slope down at the same time whatever the spacing."""

from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene
from periporo.io.input.yaml_source import read_yaml

from ... import ROOT
from .common import DEFAULT, Figure

_FINEST = 22.17  # h, at a spacing of .125 m


def failure(spacing, scheme):
    """Hours of rain until the scene `rain_slope` loses its equilibrium."""
    scene = read_yaml(ROOT / "configs" / "rain_slope.yaml").data
    scene |= {"spacing": spacing, "correspondence": scheme, "stages": scene["stages"][:2]}
    sim = build(parse_scene(scene), MPI.COMM_SELF)
    sim.start()
    sim.run()
    assert sim.stages[1].lost, "the slope stands"
    return sim.time / 3600.0


def failure_by_rain(full=False, scheme=DEFAULT):
    """W12: hours of rain until the scene rain_slope fails, at its spacing and others."""
    spacings = (1.0 / 3.0, 0.25, 0.2, 0.125) if full else (1.0 / 3.0,)
    hours = {spacing: failure(spacing, scheme) for spacing in spacings}
    known = [*hours.values(), *([] if full else [_FINEST])]
    return [
        *(Figure(f"hours at {spacing:.3g} m", found) for spacing, found in hours.items()),
        Figure("largest over smallest, less 1", max(known) / min(known) - 1.0, at_most=0.03),
    ]
