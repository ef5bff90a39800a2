"""All ranks compile for one processor, or results would be those of none: machine code decides how sums are rounded."""

from collections.abc import Callable

from mpi4py import MPI

from periporo.core.numerics import jit
from periporo.core.ranks.patience import wait_for_all
from periporo.errors import InputError, Problem


def agree(comm: MPI.Comm, wants_common: Callable[[], bool]) -> None:
    """Compare what the ranks compile for; where that differs, have all compile for what they have in common.

    `wants_common` is asked on rank 0 whether that is wanted. Raises InputError, on all ranks alike, if not, or if it is
    too late for it.
    """
    wait_for_all(comm)  # where all have started, or read what rank 0 has
    if not comm.allreduce(comm.bcast(jit.processor()) != jit.processor(), MPI.LOR):
        return
    processors = comm.allgather(jit.processor())
    other = next(r for r, processor in enumerate(processors) if processor != processors[0])
    names = f"rank 0 for {processors[0][0]}, rank {other} for {processors[other][0]}"
    if processors[0][0] == processors[other][0]:
        names += " with other features"
    remedy = "give 'cpu_target: common', or set NUMBA_CPU_NAME and NUMBA_CPU_FEATURES alike for all ranks"
    if comm.bcast(wants_common() if comm.rank == 0 else None):
        try:
            jit.compile_for(*jit.common_processor(processors))
            return
        except RuntimeError as error:
            remedy = f"{error}: start the run by the command line, or set NUMBA_CPU_NAME and NUMBA_CPU_FEATURES alike"
    raise InputError("scene", [Problem(("cpu_target",), f"ranks compile for different processors, {names}; {remedy}")])
