"""periporo: extreme deformation of soils by updated-Lagrangian periporomechanics."""

__all__ = ["Simulation", "open_results"]


def __getattr__(name):
    """Load what the package offers only when it is asked for: importing periporo itself costs nothing."""
    if name == "open_results":
        from periporo.io.results import open_results

        return open_results
    if name == "Simulation":
        from periporo.core.simulation import Simulation

        return Simulation
    raise AttributeError(f"module 'periporo' has no attribute '{name}'")
