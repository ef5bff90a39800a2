"""Machine code that comes from the cache without the compiler, and is kept without what no kernel needs.

All of this is said to the inside of numba, which promises nothing of it. It was seen alike in numba 0.60.0 and 0.68.1
(llvmlite 0.43.0 and 0.50.0). Where another version lacks a name, or means another thing by it, numba goes its own way:
kernels work as well, and start later. A remark says so.
"""

import functools
from collections.abc import Callable

import llvmlite.binding
import numba

_DIFFERS = (AttributeError, ImportError, KeyError, RuntimeError, TypeError, ValueError)
"""What a version of numba raises whose inside is another."""


def make_lean(compiled, cannot_keep: Callable[[OSError], None], remark: Callable[[str], None]) -> None:
    """Have a kernel come from the cache without the compiler, and work though its machine code cannot be written.

    Numba sets up all that it can compile before it reads machine code, a third of a second that is spent on every rank
    at once, and keeps what would be needed to call a kernel from another, which none does. `cannot_keep` is told why
    machine code cannot be written, and `remark` gets a text for users if numba is not one of those that are known.
    """

    def own_way(reason: Exception) -> None:
        remark(
            f"numba {numba.__version__} loads machine code in another way than 0.60 to 0.68 ({reason}): "
            "kernels work, but every rank starts about a third of a second later"
        )

    try:
        cache = compiled._cache
        load, save, reduce = cache.load_overload, cache.save_overload, cache._impl.reduce
        load_known, guarded = cache._load_overload, cache._guard_against_spurious_io_errors
    except AttributeError as reason:
        own_way(reason)
        return

    def load_alone(signature, target_context):
        try:
            _tell_runtime()
        except _DIFFERS as reason:
            own_way(reason)
            return load(signature, target_context)
        with guarded():
            return load_known(signature, target_context)

    def save_or_tell(signature, data):
        try:
            save(signature, data)
        except OSError as error:
            cannot_keep(error)

    def reduce_to_machine_code(result):
        whole = reduce(result)
        try:
            return _without_bitcode(whole)
        except _DIFFERS as reason:
            own_way(reason)
            return whole

    cache.load_overload, cache.save_overload, cache._impl.reduce = load_alone, save_or_tell, reduce_to_machine_code


def _without_bitcode(whole):
    """What numba keeps of a kernel, less what other kernels would need to call it, and less what is empty."""
    (name, kind, (code, _)), described, *rest, environments = whole
    entry = f'define void @"{described.llvm_cpython_wrapper_name}"() {{ ret void }}'  # numba asks if it is there
    stub = llvmlite.binding.parse_assembly(entry).as_bitcode()
    return (name, kind, (code, stub)), described, *rest, tuple(e for e in environments if e.consts)


@functools.cache
def _tell_runtime() -> None:
    """Tell machine code where numba's functions are that it calls, as its own start does before it compiles some."""
    from numba.core.runtime import _nrt_python  # here, for a version that lacks it is no reason not to run

    for name, address in _nrt_python.c_helpers.items():
        llvmlite.binding.add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
