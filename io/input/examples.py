"""The example scenes that come with the package: `periporo new` lists them, and writes one to begin with."""

import argparse
from functools import cache
from importlib import resources
from pathlib import Path

import yaml

from periporo.errors import OutputError, choice


@cache
def example_texts() -> dict[str, str]:
    """YAML text of every example, by name."""
    files = sorted(resources.files("periporo.configs").iterdir(), key=lambda file: file.name)
    return {Path(f.name).stem: f.read_text(encoding="utf-8") for f in files if f.name.endswith(".yaml")}


def files_of(name: str) -> list[str]:
    """Names of the files that an example needs beside it."""
    text = example_texts()[name]
    names = [file.name for file in resources.files("periporo.configs").iterdir()]
    return [name for name in names if name.endswith((".asc", ".csv")) and name in text]


def describe_examples() -> str:
    """A line for each example: name, dimensions, laws, title."""
    lines = []
    for name, text in example_texts().items():
        scene = yaml.safe_load(text)
        laws = ", ".join(dict.fromkeys(law["model"] for law in scene["materials"].values()))
        lines.append(f"  {name:<24}{scene['dimension']}D  {laws:<24}{scene['title']}")
    return "\n".join([*lines, "write one with: periporo new NAME [FILE.yaml]"])


def write_example(name: str, path: Path | None = None) -> Path:
    """Write an example to `path`, by default NAME.yaml in the working folder, and what it needs beside it; the path.

    Raises OutputError if the file exists, or another one of the name of what it needs, OSError if it cannot be written.
    """
    path = Path(f"{name}.yaml") if path is None else path
    try:
        with open(path, "x", encoding="utf-8") as file:
            file.write(example_texts()[name])
    except FileExistsError:
        message = f"{path} exists and is left as it is; name another file: periporo new {name} OTHER.yaml"
        raise OutputError(message) from None
    for needed in files_of(name):
        content = resources.files("periporo.configs").joinpath(needed).read_text(encoding="utf-8")
        beside = path.parent / needed
        if beside.exists() and beside.read_text(encoding="utf-8") != content:
            raise OutputError(f"{beside}, which {path} needs, exists with another content and is left as it is")
        beside.write_text(content, encoding="utf-8")
    return path


def _name(text: str) -> str:
    if text not in example_texts():
        raise argparse.ArgumentTypeError(f"no example '{text}'; {choice(text, list(example_texts()))}")
    return text


def add_arguments(parser):
    """Arguments of `periporo new`."""
    parser.add_argument("name", nargs="?", type=_name, metavar="NAME", help="example to write; without, list them")
    parser.add_argument("path", nargs="?", type=Path, metavar="FILE", help="file to write (default: NAME.yaml)")


def run(arguments):
    """Run `periporo new`; the exit status."""
    if arguments.name is None:
        print(describe_examples())
        return 0
    path = write_example(arguments.name, arguments.path)
    print(f"{path}: check it with 'periporo check {path}', run it with 'periporo {path}'")
    return 0
