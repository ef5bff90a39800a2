"""Names that a package offers although they live elsewhere, loaded only when they are asked for."""

import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any


def offer(package: str, places: dict[str, tuple[str, ...]]) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a `package` that offers the names of each module in `places`."""
    found = {name: module for module, names in places.items() for name in names}

    def get(name: str) -> Any:
        if name not in found:
            raise AttributeError(f"module '{package}' has no attribute '{name}'")
        return getattr(import_module(found[name]), name)

    def names() -> list[str]:
        return sorted({*vars(sys.modules[package]), *found})

    return get, names
