"""Answers that stay right outside the examples: small inputs that once went wrong, with the right value of each.

    python -m benchmarks faults [--row A1 E5 ...] [--write]

A row is a scene that is run here and measured, or the tests that hold it, which are run. Rows are named by their kind:
A energy from nothing or a wrong motion, B valid runs that stopped, C laws and `drive`, D lattices, E files, ranks and
operations. `--write` keeps the table in docs/reference/verification/faults.md. Exit status 1 if a row is missed.
"""

import re
import subprocess
import sys
import textwrap
from collections.abc import Callable
from dataclasses import dataclass

from mpi4py import MPI

from periporo.core.scene.build import build
from periporo.io.input.load import parse_scene

from . import ROOT, option_parser

PAGE = ROOT / "docs" / "reference" / "verification" / "faults.md"
SOIL = {"model": "elastic", "density": 1800.0, "bulk_modulus": 25e5, "shear_modulus": 15e5}
FLOOR = {"type": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0], "friction": 0.0}
HEAD = """# Outside the examples

For readers who ask what happens when a scene is not like those that are shipped, and for those who change the code and
want to know which test guards what. Each row is a kind of input that once gave a wrong answer, or none; what is right;
what holds it: a scene that is run and measured, or tests (a file below `tests`, and the part of their names that
pytest's option `-k` takes); and what else of its kind was found and cured.

    python -m benchmarks faults --write          # runs all that holds the rows, and makes this page
    python -m benchmarks faults --row A3 E5      # some rows

Scenes drawn at random are another guard: `python -m benchmarks random_scenes`.
"""
LETTERS = {
    "A": "energy from nothing, or a wrong motion", "B": "valid runs that stopped", "C": "laws and `drive`",
    "D": "lattices", "E": "files, ranks and operations",
}  # fmt: skip


@dataclass(frozen=True)
class Row:
    """What goes into a row: `how` is a function that gives the value found and whether it is right, or tests.

    `also` is what else the kind held.
    """

    name: str
    what: str
    right: str
    how: Callable[[], tuple[str, bool]] | tuple[str, ...]
    also: str = ""

    def run(self) -> tuple[str, bool]:
        """The value found, and whether it is met."""
        return self.how() if callable(self.how) else tested(self.how)

    def entry(self, found: str) -> str:
        """What the page says of it."""
        tests = () if callable(self.how) else self.how
        held = ", ".join(f"`{_shown(test)}`" for test in tests) or f"a scene that is run: {found}"
        text = f"**{self.name}**, {self.what}: {self.right}. Held by {held}."
        text += f" Too: {self.also}." if self.also else ""
        return textwrap.fill(text, 120, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)


def _shown(test):
    file, _, name = test.partition("::")
    return f"{file} -k '{name}'" if " " in name else f"{file} -k {name}" if name else file


def tested(tests: tuple[str, ...]) -> tuple[str, bool]:
    """How many of these tests pass: a file, or a file and a part of their names."""
    ends = [subprocess.run([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *_words(test)], cwd=ROOT,
                           capture_output=True, text=True) for test in tests]  # fmt: skip
    passed = [int((re.findall(r"(\d+) passed", end.stdout) or [0])[-1]) for end in ends]
    return f"{sum(passed)} tests", all(end.returncode == 0 and n for end, n in zip(ends, passed, strict=True))


def _words(test):
    file, _, name = test.partition("::")
    return [f"tests/{file}", *(["-k", name] if name else [])]


def scene(shapes, *, velocities=(), contacts=(FLOOR,), gravity=-9.81, spacing=0.01, duration=0.02, soil=SOIL, **keys):
    """A scene of bodies with these shapes in the plane."""
    bodies = [{"name": f"b{k}", "material": "soil", "shape": shape} for k, shape in enumerate(shapes)]
    for body, velocity in zip(bodies, velocities, strict=False):
        body["velocity"] = velocity
    stages = [{"name": "go", "type": "dynamics", "duration": duration}]
    return {
        "dimension": 2, "spacing": spacing, "gravity": [0.0, gravity], "materials": {"soil": soil}, "bodies": bodies,
        "contacts": list(contacts), "stages": stages,
    } | keys  # fmt: skip


def box(lower, upper):
    """A box as a scene has it."""
    return {"type": "box", "lower": lower, "upper": upper}


def ran(data, watch=lambda sim: None):
    """The simulation of a scene at its end; `watch` is called after every step."""
    sim = build(parse_scene(data), MPI.COMM_SELF)
    sim.call_every(1, watch)
    sim.run()
    return sim


def flush_boxes():
    """A1: two boxes, one on the other, without load."""
    touch = {"type": "bodies", "between": "all", "friction": 0.3}
    sim = ran(scene([box([0, 0], [0.1, 0.1]), box([0, 0.1], [0.1, 0.2])], contacts=[touch], gravity=0.0))
    kinetic = sim.ledger.kinetic()
    return f"{kinetic:.1e} J", kinetic < 1e-20


def loose_point():
    """A3: one point on an undamped floor, thrown up with 1 m/s; its highest place above where it lay."""
    stiff = {"model": "elastic", "density": 1800.0, "bulk_modulus": 25e6, "shear_modulus": 15e6}
    highest = [0.0]

    def watch(sim):
        highest[0] = max(highest[0], float(sim.particles.position[0, 1]) - 0.005)

    ran(scene([box([0, 0], [0.01, 0.01])], velocities=[[0.0, 1.0]], soil=stiff, duration=2.0), watch)
    return f"{highest[0]:.4f} m", 0.0505 < highest[0] < 0.0511


def obstacle_of_a_later_stage():
    """A9: a plane that moves with 1 m/s and appears in the second stage, which lasts 10 ms; where it ends."""
    plate = {"type": "box", "lower": [-0.2, 0.2], "upper": [0.2, 0.3], "friction": 0.0, "velocity": [0.0, -1.0],
             "stages": ["press"]}  # fmt: skip
    stages = [{"name": name, "type": "dynamics", "duration": 0.01} for name in ("wait", "press")]
    sim = ran(scene([box([-0.05, 0.0], [0.05, 0.1])], contacts=[FLOOR, plate], stages=stages))
    contact = next(c for c in sim.contacts if c.motion is not None)
    moved = float(contact.pose.shift[1])
    return f"{moved:.5f} m", abs(moved + 0.01) < 1e-3 * 0.01 + sim.dt


def friction_of_a_smooth_floor():
    """E11: what friction takes from a block on a moving floor without friction, J."""
    belt = FLOOR | {"velocity": [1.0, 0.2]}
    lost = [0.0]

    def watch(sim):
        lost[0] = min(lost[0], sim.ledger.entries()["friction_dissipation"])

    ran(scene([box([0.0, 0.0], [0.1, 0.05])], contacts=[belt]), watch)
    return f"{lost[0]:.1e} J at least", lost[0] >= 0.0


def soil_that_stiffens():
    """A6: a column of sand whose moduli grow with pressure; how deep its lowest cells reach into the floor."""
    sand = {"model": "arena"}
    column = scene([box([0.0, 0.0], [2.0, 8.0])], spacing=0.5, duration=0.2, soil=sand, contacts=[FLOOR])
    column["initial_stress"] = {"type": "geostatic", "K0": 0.5}
    sim = ran(column)
    contact = next(c for c in sim.contacts if hasattr(c, "overlaps"))
    deepest = float(contact.overlaps(sim.particles).max()) / 0.5
    return f"{deepest:.1e} spacings", 0.0 <= deepest < 0.1


BODIES, RIGID = "unit/contact/test_bodies.py", "unit/contact/test_rigid.py"
STAGES, CLI = "unit/motion/test_stages.py", "unit/test_cli.py"
DOUBTS, ORIGIN = "unit/scene/test_doubts.py", "unit/scene/test_origin.py"
WATCH, LATTICE = "unit/watch/test_watchdog.py", "unit/geometry/test_lattice.py"
DRIVER, PHASES, KIT = "materials/test_driver.py", "materials/test_phases.py", "materials/test_testing.py"
ARENA, LEAVE = "materials/test_arena_parts.py", "unit/points/test_departures.py"
WRITER, JIT = "unit/output/test_writer.py", "unit/numerics/test_jit.py"
OBSERVERS, PLOTS = "unit/watch/test_observers.py", "unit/pictures/test_plots.py"
ROWS = (
    Row("A1", "two flush boxes, no load", "nothing moves", flush_boxes, "re-entrant corners, debris, lattice slopes"),
    Row("A1", "restitution of bars and discs, two spacings and safeties", "1.00 +- .02",
        (f"{BODIES}::restitution",), "friction, both momenta; torn bodies and cells squeezed flat"),
    Row("A2", "bodies that overlap at the start", "refused, whatever the stage", (f"{BODIES}::overlap",),
        "every pair of `between: all`"),
    Row("A2", "obstacles and substrates that appear in soil", "refused",
        (f"{DOUBTS}::obstacles", f"{STAGES}::appears or placed"), "soil that is placed in obstacles"),
    Row("A2", "an obstacle that appears at the skin of soil", "no energy", (f"{RIGID}::what_overlaps",)),
    Row("A3", "one loose point thrown up with 1 m/s", "never above .0510 m", loose_point,
        "steps that begin or end off an obstacle; contact that gives is a fault of the run"),
    Row("A4", "a plane of stiffness 1e12 that appears", "flies off as it came", (f"{STAGES}::step_is_chosen",)),
    Row("A5", "impacts as fast as waves", "no step beyond .1 spacing or strain",
        ("unit/test_simulation.py::no_step_moves",), "signals within a second"),
    Row("A6", "a floor below soil that stiffens with pressure", "less than .1 spacing", soil_that_stiffens),
    Row("A6", "stiffness of a contact when moduli grow", "follows, without a gain", (f"{RIGID}::follows",),
        "points that passed an obstacle; thin ones are doubted"),
    Row("A7", "a velocity, and a relaxation first", "kept until the first motion", (f"{STAGES}::velocity_waits",)),
    Row("A8", "rest before a plate arrives", "not at rest", (f"{STAGES}::rest",)),
    Row("A9", "an obstacle that appears in the second stage", "-0.01 m", obstacle_of_a_later_stage),
    Row("A9", "histories that are over at their first use", "a doubt", (f"{DOUBTS}::histories",),
        "of obstacles, rotations, water; holding on is no doubt"),
    Row("A10", "regions that end on a row", "hold the row", (f"{LATTICE}::regions",), "layers"),
    Row("A11", "traction on a region that spans bodies", "the last one alone",
        ("unit/scene/test_boundaries.py::spans_bodies",)),
    Row("A12", "a beam one point thick", "told how many points bear nothing", (f"{CLI}::points_without_company",),
        "a scene of dust has no run-out"),
    Row("A13", "motion far from zero", "that at zero", (f"{ORIGIN}::motion_far",), "terrain at map coordinates"),
    Row("A14", "relaxation of what flows", "an error with the way it went", (f"{STAGES}::flows",)),
    Row("B", "free flight faster than waves, loose grains", "no repairs", (f"{WATCH}::faster", f"{WATCH}::loose_grain"),
        "lumps that pass each other"),
    Row("B", "viscous damping at any rate", "exact", ("unit/loads/test_boundary.py::any_rate",)),
    Row("B", "points that leave", "counted, ledger closes", (LEAVE,),
        "all have left: the run, pictures, `info` and rasters go on"),
    Row("C1", "BETA > 1", "refused unless allowed", (f"{ARENA}::shear_limit or rules",), "one that varies, too"),
    Row("C2", "rows without state reach laws", "part of the kit", (f"{KIT}::breaches",)),
    Row("C3", "cones follow the dimension, angles are told", "in TC, TE, PS", (f"{CLI}::angles_of_friction",)),
    Row("C4", "turns between rows of F", "no strain; det F > 0", (f"{DRIVER}::turn",), "any axis, 180 degrees"),
    Row("C5", "laws that fail in `drive`", "status 3 and the rows so far", (f"{DRIVER}::fails",)),
    Row("C5", "stresses that cannot be reached", "how far they came, at the strength",
        (f"{PHASES}::cannot_be_reached", f"{DRIVER}::impossible"), "Newton's method stopped at first yield"),
    Row("C6", "bounds of parameters", "by unit", ("unit/schema/test_mutations.py::by_its_unit",), "of plugins"),
    Row("C7", "damage on the cap", "none", (f"{ARENA}::damage or coherence",), "soil that failed long ago"),
    Row("C8", "saturated sand", "eqs 55-66", (f"{ARENA}::skempton or not_made or drained_start",)),
    Row("C8", "a start that a law has no state for", "an input error", (f"{WATCH}::without_a_state",),
        "geostatic stress, Weibull draws, laws of others; on all ranks"),
    Row("C9", "specimen of scattered strength", "volume and id settable", (f"{DRIVER}::scatters",)),
    Row("C10", "derived state and dissipation", "in files, in the ledger", ("unit/points/test_fields.py",)),
    Row("C11", "moduli against the response", "compared", (f"{KIT}::moduli",), "not taken for a limit of tension"),
    Row("C12", "a law refuses a step", "half of it is tried", (f"{WATCH}::refuse", f"{KIT}::refuse"), "`drive`, kit"),
    Row("C13", "plastic strain, Weibull laws, samples, closed cycles", "as in the manual",
        (f"{ARENA}::weibull or sample or plastic_strain or closed",)),
    Row("D", "polygons that share an inclined edge, dams", "one lattice, no holes",
        (f"{LATTICE}::edge", f"{LATTICE}::dam", f"{LATTICE}::touch_themselves"),
        "prisms; rings around cores; polygons closed by their first corner"),
    Row("D", "depth above a point in `check`", "that of its own column", (f"{DOUBTS}::judged",)),
    Row("E1", "result files by name", "VTK shows points and obstacles", (f"{CLI}::vtk_knows",)),
    Row("E2", "files at each flush, after a kill", "whole", (f"{WRITER}::whole", f"{WRITER}::mends"), "in parts"),
    Row("E3", "a kernel cache of another user", "refused", (f"{JIT}::ours_alone",), "links, files, open modes"),
    Row("E4", "ranks on different processors", "refused, or in common", ("mpi/test_processors.py",)),
    Row("E5", "signals to mpirun and to one rank", "a checkpoint", ("mpi/test_checkpoint.py::signals",)),
    Row("E6", "sources of plugins; full and read-only caches", "compiled anew; told; used",
        (f"{JIT}::follows", f"{JIT}::full_disk", f"{JIT}::lies_ready")),
    Row("E7", "locks of running files", "read, as they are now", ("unit/output/test_results.py::running",)),
    Row("E8", "empty variables of launchers", "asked when ranks matter", (f"{CLI}::launchers",)),
    Row("E9", "no shared memory", "told", (f"{CLI}::shared_memory",)),
    Row("E10", "outputs of fixed steps", "at n intervals", (f"{OBSERVERS}::multiples",)),
    Row("E11", "friction on a moving floor without any", "never below 0", friction_of_a_smooth_floor,
        "forces, torques and power of obstacles"),
    Row("E12", "height against gravity, pictures by step", "from the bodies' own place",
        (f"{OBSERVERS}::figures", PLOTS)),
    Row("E13", "messages; scenes as PyYAML reads them", "say what is wrong",
        (f"{CLI}::pyyaml", f"{CLI}::misspelt", f"{DRIVER}::bad_paths", f"{CLI}::nobody_reads"),
        "`check`, too, when nobody reads"),
)  # fmt: skip


def write(entries: list[str]) -> None:
    """Make the page of the entries of all rows."""
    sections = [HEAD]
    for letter, meaning in LETTERS.items():
        own = [entry for entry, row in zip(entries, ROWS, strict=True) if row.name[0] == letter]
        sections.append("\n".join([f"\n## {letter}: {meaning}\n", *own, ""]))
    PAGE.write_text("".join(sections))


def main(words=None):
    """Run the rows, and print them."""
    parser = option_parser(__name__, __doc__)
    parser.add_argument("--row", nargs="*", default=[], help="names of rows, such as A1")
    parser.add_argument("--write", action="store_true", help="keep the table in the documents")
    arguments = parser.parse_args(words)
    entries, missed = [], []
    for row in ROWS:
        if arguments.row and row.name not in arguments.row:
            continue
        found, met = row.run()
        missed += [] if met else [row.name]
        entries.append(row.entry(found))
        print(f"{row.name:4}{row.what}: {found}, {'met' if met else 'MISSED'}", flush=True)
    if arguments.write:
        write(entries)
    print(f"missed: {', '.join(missed) or 'none'}", file=sys.stderr)
    sys.exit(1 if missed else 0)
