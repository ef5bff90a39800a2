"""The scene sensitive_clay: the slope yields at its toe, in strain that is averaged; the bank behind does not know."""

from pathlib import Path

import numpy as np

import periporo
from periporo.core.motion.nonlocal_strain import NonlocalStrain
from periporo.io.input.yaml_source import read_yaml

CONFIG = Path(periporo.__file__).parent / "configs" / "sensitive_clay.yaml"


def test_the_bank_begins_to_fail_at_its_toe():
    scene = read_yaml(CONFIG).data | {"spacing": 1.25}
    scene["stages"] = [scene["stages"][0] | {"duration": 0.6}]
    sim = periporo.Simulation.from_scene(scene)
    assert any(isinstance(part, NonlocalStrain) for part in sim.point_processes)
    sim.run()
    p = sim.particles
    start, strain = p.initial_position[: p.owned], sim.bonds.blocks[0].state[:, 0]
    sheared = start[strain > 0.5 * strain.max()]
    assert strain.max() > 0.05 and sheared[:, 0].max() < 40.0 and np.median(sheared[:, 1]) < 11.0
    moved = np.linalg.norm(p.position[: p.owned] - start, axis=1)
    assert moved[start[:, 0] < 20.0].max() > 0.3 and moved[start[:, 0] > 80.0].max() < 0.15
