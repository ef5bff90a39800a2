"""The command line of the benchmarks.

    python -m benchmarks                    lists them
    python -m benchmarks NAME [options]     runs one; NAME --help explains it
"""

import ast
import difflib
import importlib
import sys
from pathlib import Path

FOLDER = Path(__file__).parent


def benchmarks() -> dict[str, str]:
    """What each benchmark finds out, by name: the first line of its docstring, read without importing it."""
    files = (file for file in sorted(FOLDER.glob("*.py")) if not file.name.startswith("_"))
    return {file.stem: ast.get_docstring(ast.parse(file.read_text())).splitlines()[0] for file in files}


def main(words: list[str]) -> int | None:
    """List the benchmarks, or run the one that is named; its exit status."""
    known = benchmarks()
    if not words or words[0] in ("-h", "--help"):
        print(__doc__.strip() + "\n")
        width = max(map(len, known))
        print("\n".join(f"{name:{width}}  {line}" for name, line in known.items()))
        return 0
    name, *options = words
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        print(f"there is no benchmark {name}{hint}; `python -m benchmarks` lists them", file=sys.stderr)
        return 2
    return importlib.import_module(f"benchmarks.{name}").main(options)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
