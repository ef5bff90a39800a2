"""Progress and messages, with a clock of our own."""

import io
from types import SimpleNamespace

import pytest
from rich.console import Console

from periporo.io.output.log import Progress


class Clock:
    """Seconds that the test advances."""

    def __init__(self):
        self.seconds = 0.0

    def __call__(self):
        return self.seconds


def progress_on(*, rank=0, enabled=True, terminal=False):
    clock, text = Clock(), io.StringIO()
    console = Console(file=text, force_terminal=terminal, width=100, highlight=False, soft_wrap=True)
    return Progress(SimpleNamespace(rank=rank), enabled, console=console, now=clock), clock, text


def advance(progress, clock, steps, *, seconds, dt=0.01, first=0, **figures):
    for step in range(first + 1, first + steps + 1):
        clock.seconds += seconds
        progress.update(step * dt, dt, step, **figures)


def test_plain_lines_come_every_five_seconds():
    progress, clock, text = progress_on()
    progress.start_stage("collapse", 10.0, 2000)
    advance(progress, clock, 140, seconds=0.125)
    lines = text.getvalue().splitlines()
    assert lines[0] == "collapse: 2,000 points, until 10 s"
    assert [line.split("step ")[1].split()[0] for line in lines[1:]] == ["1", "41", "81", "121"]


def test_rates_and_time_left():
    progress, clock, text = progress_on()
    progress.start_stage("collapse", 10.0, 2000)
    figures = {"kinetic_energy": 1234.5, "max_speed": 2.0, "rebuilds": 7, "imbalance": 1.04}
    advance(progress, clock, 81, seconds=0.125, **figures)
    line = text.getvalue().splitlines()[-1]
    # 8 steps of 0.01 s each second: at 0.81 s of 10 s, 9.19 s are left at 0.08 s a second
    assert "dt 0.01 s  8 steps/s  16k point-steps/s" in line
    assert "t = 0.81 / 10 s  step 81  " in line
    assert "1 min 55 s left" in line and "collapse  8.0 %" in line
    assert "kinetic 1.23e+03 J" in line and "max speed 2 m/s" in line
    assert "rebuilds 7" in line and "imbalance 1.04" in line


def test_share_and_rates_are_those_of_the_stage():
    progress, clock, text = progress_on()
    progress.start_stage("one", 1.0, 10)
    advance(progress, clock, 100, seconds=1.0)
    progress.finish_stage()
    progress.start_stage("two", 3.0, 10)
    advance(progress, clock, 81, seconds=0.125, first=100)
    line = text.getvalue().splitlines()[-1]
    assert line.startswith("two  40.2 %") and " 8 steps/s" in line  # 0.8 s of 1.99 s


def test_rates_follow_the_last_half_minute():
    progress, clock, text = progress_on()
    progress.start_stage("collapse", 100.0, 1)
    advance(progress, clock, 100, seconds=1.0)
    advance(progress, clock, 1000, seconds=0.125, first=100)
    assert " 8 steps/s" in text.getvalue().splitlines()[-1]


def test_stage_without_an_end_and_its_finish():
    progress, clock, text = progress_on()
    progress.start_stage("relaxation", None, 5)
    advance(progress, clock, 41, seconds=0.125, residual=1e-4)
    clock.seconds += 3600
    progress.finish_stage("out of balance 1e-5")
    lines = text.getvalue().splitlines()
    assert "%" not in lines[2] and "left" not in lines[2] and "residual 0.0001" in lines[2]
    assert lines[-1] == "relaxation: done in 1 h 00 min; out of balance 1e-5"
    progress.update(1.0, 0.01, 42)  # between stages nothing is shown
    assert text.getvalue().splitlines() == lines


def test_messages_are_printed_as_they_are():
    progress, _, text = progress_on()
    progress.message("compiling [bold] kernels (once, ~20 s): " + "x" * 200)
    assert text.getvalue() == "compiling [bold] kernels (once, ~20 s): " + "x" * 200 + "\n"


@pytest.mark.parametrize("options", [{"rank": 1}, {"enabled": False}])
def test_silent_elsewhere(options):
    progress, clock, text = progress_on(**options)
    with progress:
        progress.message("hello")
        progress.start_stage("collapse", 1.0, 10)
        advance(progress, clock, 100, seconds=1.0)
        progress.finish_stage("text")
    assert text.getvalue() == ""


def test_live_view_on_a_terminal_and_the_cursor_comes_back():
    progress, clock, text = progress_on(terminal=True)
    with pytest.raises(RuntimeError, match="stop"), progress:
        progress.start_stage("collapse", 1.0, 10)
        advance(progress, clock, 50, seconds=0.25, max_speed=1.5)
        progress.message("a message")
        assert "━" * 12 + "─" * 12 in text.getvalue()  # half done
        raise RuntimeError("stop")
    shown = text.getvalue()
    assert "a message" in shown and "max speed 1.5 m/s" in shown and "50.0 %" not in shown
    assert shown.count("steps/s") > 10  # refreshed four times a second
    assert shown.rindex("\x1b[?25h") > shown.rindex("\x1b[?25l")  # cursor hidden, then shown again
