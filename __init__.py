"""periporo: extreme deformation of soils by updated-Lagrangian periporomechanics.

Importing it costs nothing: what it offers is loaded when it is asked for.
"""

from typing import TYPE_CHECKING

from periporo.lazy import offer

if TYPE_CHECKING:
    from periporo.core.run import run
    from periporo.core.simulation import Simulation
    from periporo.core.study.study import study
    from periporo.errors import InputError
    from periporo.io.output.results import open_results
    from periporo.materials.laboratory.drive import drive
    from periporo.materials.laboratory.fit import fit
else:
    __getattr__, __dir__ = offer(__name__, {
        "periporo.core.run": ("run",),
        "periporo.core.scene.source": ("Simulation",),
        "periporo.core.study.study": ("study",),
        "periporo.errors": ("InputError",),
        "periporo.io.output.results": ("open_results",),
        "periporo.materials.laboratory.drive": ("drive",),
        "periporo.materials.laboratory.fit": ("fit",),
    })  # fmt: skip

__all__ = ["InputError", "Simulation", "drive", "fit", "open_results", "run", "study"]
