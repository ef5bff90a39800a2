"""The example slope stands with the strength that its configuration gives, and fails with less."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import periporo

CONFIG = Path(periporo.__file__).parent / "configs" / "slope.yaml"


@pytest.mark.parametrize("cohesion", [12e3, 2e3])
def test_slope(cohesion, started):
    scene, stands = yaml.safe_load(CONFIG.read_text()), cohesion > 6.4e3
    scene["materials"]["silt"] |= {"cohesion": cohesion, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    scene["materials"]["rock"] |= {"bulk_modulus": 50e6, "shear_modulus": 30e6}
    scene["stages"][-1]["duration"] = 2.0
    scene["stages"] = scene["stages"] if stands else scene["stages"][1:]
    sim = started(scene)
    for stage in sim.stages:
        stage.run(sim)
    p = sim.particles
    moved = np.sqrt(((p.position - p.initial_position) ** 2).sum(axis=1)).max()
    speed = np.sqrt((p.velocity**2).sum(axis=1)).max()
    if stands:
        assert moved < 0.01 and speed < 0.005
    else:
        assert moved > 1.0 and speed > 0.3
