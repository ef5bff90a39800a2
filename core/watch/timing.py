"""Where the time of a run goes: laps of the step, added up by name."""

import time


class Timing:
    """Seconds of wall time by part of the step."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def start(self) -> None:
        """Begin a step."""
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        """Credit the time since the last lap to `name`."""
        now = time.perf_counter()
        self.seconds[name] = self.seconds.get(name, 0.0) + now - self._last
        self._last = now

    def reset(self) -> None:
        """Forget all laps, for example those of a run-in."""
        self.seconds.clear()

    def lines(self) -> list[str]:
        """A line for each part, the largest first, with its share."""
        total = sum(self.seconds.values()) or 1.0
        parts = sorted(self.seconds.items(), key=lambda item: -item[1])
        return [f"{name:16s} {seconds:9.3f} s {100 * seconds / total:5.1f} %" for name, seconds in parts]
