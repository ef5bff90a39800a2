"""Benchmarks and studies of a checkout, behind one command line: `python -m benchmarks` lists them.

Each module of this folder is one of them: the first line of its docstring is its line in the list, and
`main(words)` runs it with the words that follow its name. What several of them need is in `library`.
"""

import argparse
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FIGURES = ROOT / "docs" / "figures"


def option_parser(module: str, text: str) -> argparse.ArgumentParser:
    """The parser of a benchmark's options, from its `__name__` and `__doc__`."""
    name = f"python -m benchmarks {module.rpartition('.')[2]}"
    return argparse.ArgumentParser(prog=name, description=text, formatter_class=argparse.RawDescriptionHelpFormatter)
