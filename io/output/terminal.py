"""What rank 0 writes its progress to."""

import os
import sys
from typing import IO

from rich.console import Console
from rich.live import Live
from rich.text import Text


def say(text: str) -> None:
    """Print a text; nothing more is said when nobody reads it any more, as behind `| head`."""
    try:
        print(text, flush=True)
    except BrokenPipeError:
        fall_silent(sys.stdout)


def fall_silent(file: IO[str]) -> None:
    """Have what is written to a file go nowhere."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), file.fileno())


class PatientConsole(Console):
    """A console that falls silent when nobody reads it any more: a run goes on when its `tee` or pipe has ended."""

    def on_broken_pipe(self):
        """In place of ending the program."""
        self.quiet = True
        fall_silent(self.file)


class LiveText(Live):
    """Lines that are written over by those that follow."""

    def __init__(self, console: Console):
        super().__init__(Text(""), console=console, auto_refresh=False, transient=True)

    def show(self, text: str) -> None:
        """Write `text` over what was shown before."""
        self.update(Text(text, overflow="fold"), refresh=True)
