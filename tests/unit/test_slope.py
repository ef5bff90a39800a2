"""The example slope stands with the strength that its configuration gives, and fails with less."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import periporo

CONFIG = Path(periporo.__file__).parent / "configs" / "slope.yaml"


@pytest.mark.parametrize("cohesion", [12e3, 2e3])
def test_slope(cohesion, started):
    scene = yaml.safe_load(CONFIG.read_text())
    scene["materials"]["silt"] |= {"cohesion": cohesion, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    scene["materials"]["rock"] |= {"bulk_modulus": 50e6, "shear_modulus": 30e6}
    sim = started(scene)
    stage = sim.stages[0]
    stage.duration = 2.0
    stage.run(sim)
    p = sim.particles
    moved = np.sqrt(((p.position - p.initial_position) ** 2).sum(axis=1)).max()
    speed = np.sqrt((p.velocity**2).sum(axis=1)).max()
    if cohesion > 6.4e3:
        assert moved < 0.05 and speed < 0.02
    else:
        assert moved > 1.0 and speed > 0.3
