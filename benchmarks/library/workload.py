"""Kernels and short scenes whose speed is followed: the part of `python -m benchmarks regress` that runs a version.

Started as a program of its own, with the version to measure first on PYTHONPATH. It reads names from the standard
input and answers each with a line of JSON: seconds by measurement. It knows the program from outside only
(`Simulation.from_scene`, `run`, `timing`), so that one text drives versions whose files lie elsewhere.
"""

import json
import sys
import time

ELASTIC = {"model": "elastic", "density": 1760.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
SAND = ELASTIC | {"model": "drucker_prager", "cohesion": 100.0, "friction_angle": 30.0}
CLAY = {
    "model": "cam_clay", "grain_density": 2200.0, "porosity": 0.2, "bulk_modulus": 25e6, "shear_modulus": 15e6,
    "critical_state_slope": 1.1, "compression_index": 0.12, "swelling_index": 0.04, "viscosity": 1000.0,
    "overconsolidation_ratio": 1.25,
}  # fmt: skip
ARENA = {"model": "arena", "density": 1810.0, "initial_porosity": 0.4, "initial_saturation": 0.5}
SHARPENED = {"scheme": "point_state", "sharpened": True}


def box(lower, upper, **keys) -> dict:
    """A body of soil."""
    return {"name": "block", "material": "soil", "shape": {"type": "box", "lower": lower, "upper": upper}} | keys


def free(dimension, side, steps, soil=ELASTIC, scheme=SHARPENED, **keys) -> dict:
    """A cube of side**dimension points that flies, so that neighbours are found anew, and shears by its own stress."""
    step = 2.5e-3 / side  # s, about what the elastic moduli allow at a spacing of 1/side m
    stress = {"xx": -2000.0, "yy": -500.0, "zz": -800.0}
    return {
        "dimension": dimension, "spacing": 1.0 / side, "correspondence": scheme, "materials": {"soil": soil},
        "bodies": [box([0.0] * dimension, [1.0] * dimension, velocity=[2.0] + [0.0] * (dimension - 1))],
        "initial_stress": {"type": "uniform", "components": stress},
        "stages": [{"name": "flight", "type": "dynamics", "duration": steps * step}],
    } | keys  # fmt: skip


def collapse(dimension, soil, columns, rows, steps, **keys) -> dict:
    """A column (or a block) of soil on a rough floor that falls apart under its weight."""
    spacing = 0.1 / rows
    half = 0.5 * columns * spacing
    level = [0.0] * (dimension - 1)
    return {
        "dimension": dimension, "spacing": spacing, "gravity": [*level, -9.81], "materials": {"soil": soil},
        "bodies": [box([-half] * (dimension - 1) + [0.0], [half] * (dimension - 1) + [0.1])],
        "initial_stress": {"type": "geostatic", "K0": 0.6},
        "contacts": [{"type": "plane", "point": [*level, 0.0], "normal": [*level, 1.0], "friction": 0.5}],
        "stages": [{"name": "collapse", "type": "dynamics", "duration": steps * 2.5e-4 / rows}],
            } | keys  # fmt: skip


def pressed(side, steps) -> dict:
    """Two blocks that rub against each other on a floor."""
    scene = collapse(2, ELASTIC, side, side, steps)
    under, over = scene["bodies"][0], box([-0.05, 0.1], [0.05, 0.2], name="upper", velocity=[0.5, -0.5])
    return scene | {
        "bodies": [under | {"name": "lower"}, over],
        "contacts": [*scene["contacts"], {"type": "bodies", "first": "lower", "second": "upper", "friction": 0.3}],
    }


KERNELS = {  # by the name of their scene: the scene, and the parts of its steps that are measured
    "plane": (free(2, 50, 40), ("strain", "internal force", "integration", "rebuild", "time step")),
    "plane, bond_projected": (free(2, 50, 40, scheme="bond_projected"), ("strain", "internal force")),
    "space": (free(3, 13, 30, scheme="point_state"), ("strain", "internal force", "rebuild")),
    "drucker_prager": (free(2, 60, 40, SAND), ("material",)),
    "cam_clay": (free(2, 60, 40, CLAY), ("material",)),
    "arena": (free(2, 16, 12, ARENA), ("material",)),
    "blocks": (pressed(36, 40), ("contact",)),
}
SCENES = {
    "column of clay": collapse(2, CLAY, 40, 40, 60),
    "column of sand": collapse(2, SAND, 40, 40, 60),
    "cube of sand": collapse(3, SAND, 10, 10, 40, correspondence="point_state"),
    "flow of clay in space": collapse(3, CLAY, 12, 12, 300),
    "flow of sand in space": collapse(3, SAND, 12, 12, 300),
}
NAMES = (*KERNELS, *SCENES)


def measure(name: str) -> dict[str, float]:
    """Seconds of processor time that a scene takes from its start, or kernels in a step of theirs, by name."""
    from periporo import Simulation

    scene, parts = KERNELS.get(name, (SCENES.get(name), None))
    simulation = Simulation.from_scene(scene)
    simulation.start()
    simulation.timing.reset()
    simulation.run()
    seconds = simulation.timing.seconds
    if parts is None:
        return {name: sum(seconds.values())}
    return {f"{name}: {part}": seconds[part] / simulation.step_number for part in parts if part in seconds}


def serve() -> None:
    """Answer what is asked, until the input ends; first with the place of the program, or why it cannot be had."""
    time.perf_counter = time.process_time  # of the laps: what else the machine does must not count
    import periporo

    answer(periporo.__file__)
    for line in sys.stdin:
        try:
            answer(measure(line.strip()))
        except Exception as error:  # a feature that this version lacks, say: the reader decides
            answer({"error": f"{type(error).__name__}: {error}"})


def answer(what) -> None:
    """A line of JSON."""
    print(json.dumps(what), flush=True)


if __name__ == "__main__":
    serve()
