"""The public surface as a strict type checker sees it (`.ci/run`); never run."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, assert_type

import numpy as np

import periporo
from periporo.materials import (
    COMPONENTS,
    Material,
    MaterialParameters,
    StateField,
    built_in_path,
    check_material,
    component_count,
    drive,
    from_matrix,
    state_columns,
    to_matrix,
)


class Spring(MaterialParameters):
    """A law as its author writes it, which has what the protocol asks for."""

    density: float
    stiffness: float
    state_fields: tuple[StateField, ...] = ()

    def initial_state(self, stress: np.ndarray, ids: np.ndarray, volume: np.ndarray) -> np.ndarray:
        return np.zeros((len(stress), 0))

    def compute_stress(
        self, stress: np.ndarray, strain_increment: np.ndarray, state: np.ndarray, dt: float
    ) -> None:
        stress += self.stiffness * strain_increment

    def elastic_moduli(self, stress: np.ndarray, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return np.full(len(stress), self.stiffness / 3), np.full(len(stress), self.stiffness / 2)


def a_law() -> None:
    law: Material = Spring(density=1000.0, stiffness=1e6)
    assert_type(check_material(law, 2).cycle_energy, float)
    assert_type(drive(law, built_in_path("triaxial", "rows=5")), dict[str, np.ndarray])
    assert_type(periporo.drive({"model": "elastic"}, "test.yaml", pictures="out"), dict[str, np.ndarray])
    assert_type(periporo.fit("soil.yaml", {"parameters": {}}).confidence, dict[str, float])
    assert_type(state_columns(law, component_count(3)), int)
    assert_type(from_matrix(to_matrix(np.zeros((1, 6))), 6), np.ndarray)
    assert_type(COMPONENTS[0], str)


def a_run(scene: dict[str, Any], seen: Callable[[periporo.Simulation], None]) -> None:
    try:
        path = periporo.run(scene, "fall.h5", callbacks=[(5, seen)], walltime=60.0)
    except periporo.InputError as error:
        assert_type([problem.message for problem in error.problems], list[str])
        return
    assert_type(path, Path)
    with periporo.open_results(path) as results:
        assert_type(results.field("stress", time=0.5), np.ndarray)
        assert_type(results.fields, tuple[str, ...])
        assert_type(len(results), int)


def a_simulation() -> None:
    simulation = periporo.Simulation.from_scene("column.yaml")
    assert_type(simulation, periporo.Simulation)
    simulation.call_every(10, lambda now: print(now.time))
    simulation.run()
    assert_type(simulation.ledger.kinetic(), float)
    assert_type(simulation.particles.position, np.ndarray)
