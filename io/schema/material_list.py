"""The installed materials with their parameters: `periporo materials`."""

import argparse

from periporo.errors import choice
from periporo.io.schema.parameters import first_sentence, law_schema, parameters_of
from periporo.materials import registry

_HEADS = ("parameter", "unit", "default", "allowed", "meaning")


def describe_material(name: str) -> str:
    """Name, package and first sentence of an installed law, and a line for each parameter.

    A law that cannot be imported is listed with the reason.
    """
    point = registry.available()[name]
    package = f" ({point.dist.name} {point.dist.version})" if point.dist else ""
    try:
        law = registry.load(name)
    except Exception as error:  # whatever a plugin does wrong; the others are listed all the same
        return f"{name}{package}: cannot be imported: {type(error).__name__}: {error}"
    node = law_schema(law)
    rows = [(p.name, p.unit, p.default, p.allowed, p.meaning) for p in parameters_of(node)]
    widths = [max(map(len, column)) for column in zip(*rows, _HEADS, strict=True)]
    lines = [f"{name}{package}: {first_sentence(node.get('description', ''))}"]
    for row in (_HEADS, *rows):
        cells = (cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        lines.append(f"  {'  '.join(cells)}".rstrip())
    return "\n".join(lines)


def _name(text: str) -> str:
    names = sorted(registry.available())
    if text not in names:
        raise argparse.ArgumentTypeError(f"no material model '{text}' is installed; {choice(text, names)}")
    return text


def add_arguments(parser):
    """Arguments of `periporo materials`."""
    parser.add_argument("names", nargs="*", type=_name, metavar="NAME", help="laws to list (default: all)")


def run(arguments):
    """Run `periporo materials`; the exit status."""
    print("\n\n".join(describe_material(name) for name in arguments.names or sorted(registry.available())))
    return 0
