"""Progress and messages of a run: a live line on a terminal, plain lines elsewhere; rank 0 speaks."""

import time as clock
from collections import deque

_LIVE_INTERVAL = 0.25  # s between two refreshes on a terminal
_PLAIN_INTERVAL = 5.0  # s between two plain lines
_WINDOW = 30.0  # s over which rates are averaged
_BAR = 24
_NAMES = {"kinetic_energy": "kinetic", "internal_energy": "internal", "max_speed": "max speed",
          "energy_residual": "residual"}
_UNITS = {"kinetic_energy": "J", "internal_energy": "J", "energy_residual": "J", "max_speed": "m/s"}


class Progress:
    """Shows how a run goes on; does nothing on ranks other than 0, or if not enabled.

    Use it in a `with` statement, which gives the terminal back even after an error.
    console: rich console to write to, standard output by default. now: clock in seconds.
    """

    def __init__(self, comm, enabled=True, *, console=None, now=clock.perf_counter):
        self.enabled = enabled and comm.rank == 0
        self._now = now
        self._console = console
        if self.enabled and console is None:
            from periporo.io.output.terminal import PatientConsole  # which loads for long: the other ranks do without

            self._console = PatientConsole(highlight=False, soft_wrap=True)
        self._live = None
        self._due = float("inf")  # clock at which the next line is due
        self._stage, self._end, self._points = "", None, 0
        self._marks = deque()  # (clock, step, simulated time) of past lines
        self._latest = None  # (simulated time, dt, step) and figures of the last update
        self._figures = {}
        self._begin = None  # simulated time at the first line of the stage
        self._started = 0.0  # clock at the start of the stage

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._stop_live()

    def message(self, text):
        """Print a line of text, above the live line if there is one."""
        if self.enabled:
            self._print(text)

    def start_stage(self, name, end_time, points):
        """A stage begins: its name, the time at which it ends (s, None if unknown), the number of points."""
        if not self.enabled:
            return
        self._stop_live()
        self._stage, self._end, self._points = name, end_time, points
        self._marks.clear()
        self._latest, self._figures, self._begin = None, {}, None
        self._started = self._now()
        self._due = self._started
        until = "" if end_time is None else f", until {end_time:.6g} s"
        self._print(f"{name}: {points:,} points{until}")
        if self._console.is_terminal:
            from periporo.io.output.terminal import LiveText

            self._live = LiveText(self._console)
            self._live.start()

    def update(self, time, dt, step, **figures):
        """Tell the state after a step: simulated time and time step (s), step number, figures to show.

        Figures are numbers such as kinetic_energy, internal_energy, max_speed (SI units), rebuilds,
        imbalance (largest load over mean load). Cheap enough to be called every step.
        """
        if self.enabled and self._now() >= self._due:
            self._latest, self._figures = (time, dt, step), figures
            self._show()

    def finish_stage(self, text=""):
        """The stage is over; print how long it took, and `text`."""
        if not self.enabled:
            return
        self._stop_live()
        self._due = float("inf")
        took = _duration(self._now() - self._started)
        self._print(f"{self._stage}: done in {took}" + (f"; {text}" if text else ""))

    def _show(self):
        now = self._now()
        time, _, step = self._latest
        if self._begin is None:
            self._begin = time
        self._marks.append((now, step, time))
        while len(self._marks) > 2 and now - self._marks[1][0] > _WINDOW:
            self._marks.popleft()
        if self._live is not None:
            self._live.show("\n".join(self._lines(live=True)))
            self._due = now + _LIVE_INTERVAL
        else:
            self._print("  ".join(self._lines(live=False)))
            self._due = now + _PLAIN_INTERVAL

    def _lines(self, live):
        """Progress, then rates, then figures."""
        time, dt, step = self._latest
        first, start_step, start_time = self._marks[0]
        elapsed = self._marks[-1][0] - first
        progress = f"t = {time:.5g} s  step {step:,}"
        rates = f"dt {dt:.3g} s"
        if elapsed > 0:
            rate = (step - start_step) / elapsed
            rates += f"  {_number(rate)} steps/s  {_number(rate * self._points)} point-steps/s"
        if self._end is not None and self._end > self._begin:
            share = min(max((time - self._begin) / (self._end - self._begin), 0.0), 1.0)
            progress = f"{self._bar(share) if live else ''}{100 * share:.1f} %  " \
                       f"t = {time:.5g} / {self._end:.5g} s  step {step:,}"
            if elapsed > 0 and time > start_time:
                left = (self._end - time) * elapsed / (time - start_time)
                rates += f"  {_duration(max(left, 0.0))} left"
        figures = [_figure(name, value) for name, value in self._figures.items()]
        return [f"{self._stage}  {progress}", rates, *(["  ".join(figures)] if figures else [])]

    def _bar(self, share):
        done, rest = ("━", "─") if self._console.encoding.startswith("utf") else ("#", "-")
        full = round(_BAR * share)
        return done * full + rest * (_BAR - full) + "  "

    def _print(self, text):
        try:
            self._console.print(text, markup=False)
            self._console.file.flush()
        except BrokenPipeError:
            self._console.on_broken_pipe()

    def _stop_live(self):
        if self._live is not None:
            self._live.stop()
            self._live = None


def _figure(name, value):
    label = _NAMES.get(name, name.replace("_", " "))
    shown = f"{value:,}" if isinstance(value, int) else f"{value + 0.0:.3g}"  # + 0.0: no minus before zero
    return f"{label} {shown} {_UNITS.get(name, '')}".rstrip()


def _number(value):
    """A count with three digits and k, M or G."""
    for limit, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if value >= limit:
            return f"{value / limit:.3g}{letter}"
    return f"{value:.3g}"


def _duration(seconds):
    """Seconds as 4.2 s, 3 min 05 s or 2 h 07 min."""
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"
