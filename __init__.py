"""periporo: extreme deformation of soils by updated-Lagrangian periporomechanics."""

from importlib import import_module

_OFFERED = {
    "Simulation": "periporo.core.scene.source",
    "run": "periporo.core.run",
    "open_results": "periporo.io.output.results",
    "InputError": "periporo.errors",
}
__all__ = ["InputError", "Simulation", "open_results", "run"]


def __getattr__(name):
    """Load what the package offers only when it is asked for: importing periporo itself costs nothing."""
    if name not in _OFFERED:
        raise AttributeError(f"module 'periporo' has no attribute '{name}'")
    return getattr(import_module(_OFFERED[name]), name)


def __dir__():
    return sorted({*globals(), *__all__})
