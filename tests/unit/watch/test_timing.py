"""Laps of the step."""

import time

from periporo.core.watch.timing import Timing


def test_laps_add_up_by_name_and_sort_by_size():
    timing = Timing()
    timing.start()
    for name, pause in (("long", 0.02), ("short", 0.0), ("long", 0.02)):
        time.sleep(pause)
        timing.lap(name)
    assert set(timing.seconds) == {"long", "short"} and timing.seconds["long"] >= 0.04
    first, second = timing.lines()
    assert first.startswith("long") and second.startswith("short") and first.endswith("%")
    timing.reset()
    assert timing.lines() == []
