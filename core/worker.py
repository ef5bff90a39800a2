"""Command lines one after the other in one process: Python, the packages and compiled kernels are loaded once.

    python -m periporo.core.worker

reads lines of its input, each a list in JSON: a folder, a file for what is said, and the words of a command line that
is carried out there. It answers each with a line, the exit status.
"""

import json
import os
import sys

from periporo.core.cli import main


def _carry_out(folder: str, log: str, *words: str) -> int:
    os.chdir(folder)
    with open(log, "w") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)
    try:
        return main(list(words))
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()


def _serve() -> None:
    with os.fdopen(os.dup(1), "w") as answers:
        for line in sys.stdin:
            print(_carry_out(*json.loads(line)), file=answers, flush=True)


if __name__ == "__main__":
    try:
        _serve()
    except KeyboardInterrupt:  # between two of them
        sys.exit(130)
