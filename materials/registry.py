"""Materials by name, found through the entry-point group `periporo.materials`."""

import difflib
import functools
import os
import sys
from importlib import metadata

GROUP = "periporo.materials"


def available() -> dict[str, metadata.EntryPoint]:
    """Entry points of every installed material by name; nothing is imported."""
    return _found_in(tuple((place, os.stat(place).st_mtime_ns) for place in sys.path if os.path.exists(place)))


@functools.lru_cache(maxsize=1)
def _found_in(places: tuple[tuple[str, int], ...]) -> dict[str, metadata.EntryPoint]:
    """The same; looking through the `places` takes ten times as long as reading a scene, unless they have changed."""
    return {point.name: point for point in metadata.entry_points(group=GROUP)}


def load(name: str) -> type:
    """The material class registered as `name`.

    Raises KeyError with the installed names, the nearest first, if there is none.
    """
    found = available()
    if name not in found:
        near = difflib.get_close_matches(name, found, n=1, cutoff=0.75)
        hint = f" Did you mean '{near[0]}'?" if near else ""
        raise KeyError(f"no material model '{name}' is installed; installed: {', '.join(sorted(found))}.{hint}")
    return found[name].load()
