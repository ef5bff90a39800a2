"""What users are told: one exception for an input that cannot be used, with its one-screen message, one for outputs."""

import difflib
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

SCREEN_LINES = 24
SCREEN_WIDTH = 100
_MAX_PROBLEMS = 15
_MAX_LINES_EACH = 3

Path = tuple[str | int, ...]


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong: where (key path and line, if known) and what, with what is allowed instead."""

    path: Path
    message: str
    line: int | None = None


class InputError(Exception):
    """The input cannot be used; `str(error)` is the complete message, short enough for one screen.

    `problems` holds every `Problem`, sorted by line; `source` names the file, or what stands for it.

    >>> try:
    ...     raise InputError("slope.yaml", [Problem(("bodies", 0, "name"), "must be text", line=7)])
    ... except InputError as error:
    ...     print(error)
    slope.yaml: 1 problem
      line 7, bodies[0].name: must be text
    """

    def __init__(self, source: str, problems: Iterable[Problem]):
        self.source = source
        self.problems = sorted(problems, key=lambda p: (p.line is None, p.line or 0))
        super().__init__(source, self.problems)

    def __str__(self) -> str:
        count = len(self.problems)
        name = shorten(printable(self.source), SCREEN_WIDTH - 20)
        lines = [f"{name}: {count} problem{'s' if count > 1 else ''}"]
        for shown, problem in enumerate(self.problems):
            block = _block(problem)
            if shown == _MAX_PROBLEMS or len(lines) + len(block) > SCREEN_LINES - 1:
                return "\n".join([*lines, f"  and {count - shown} more"])
            lines += block
        return "\n".join(lines)


class OutputError(Exception):
    """A result file cannot be opened or written; raised on all ranks alike."""


def _block(problem: Problem) -> list[str]:
    where = [f"line {problem.line}"] if problem.line else []
    where += [shorten(dotted(problem.path), 60)] if problem.path else []
    text = f"{', '.join(where)}: {problem.message}" if where else problem.message
    return textwrap.wrap(
        printable(text),
        SCREEN_WIDTH,
        initial_indent="  ",
        subsequent_indent="      ",
        max_lines=_MAX_LINES_EACH,
        placeholder=" ...",
    )


def dotted(path: Path) -> str:
    """A key path as text: ("bodies", 0, "shape") becomes `bodies[0].shape`."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else str(part)
    return text


def shorten(text: str, width: int) -> str:
    """`text`, or its start with an ellipsis if it is longer than `width` characters."""
    return text if len(text) <= width else text[: width - 3] + "..."


def printable(text: str) -> str:
    """`text` with control and other invisible characters as escapes, so that it cannot disturb a terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def described(value: Any) -> str:
    """A value as the user wrote it, with its kind where that is the point: `the text 'abc'`."""
    match value:
        case None:
            return "nothing"
        case bool():
            return f"a yes/no value ({value})"
        case str():
            return f"the text {shorten(repr(value), 40)}"
        case dict():
            return "a mapping (" + shorten(", ".join(map(str, value)), 40) + ")"
        case list() | tuple():
            return f"a list of length {len(value)}"
        case float():
            return f"{value:.10g}"
        case int() if abs(value) >= 10**20:
            return "an integer of more than 20 digits"
        case _:
            return shorten(repr(value), 40)


def nearest(word: Any, allowed: Iterable[str], cutoff: float = 0.75) -> str | None:
    """The member of `allowed` that `word` most likely stands for, or None; case does not matter.

    `cutoff` is the least similarity, from 0 (anything) to 1 (equal).
    """
    by_lower = {name.lower(): name for name in allowed}
    found = difflib.get_close_matches(str(word)[:80].lower(), by_lower, n=1, cutoff=cutoff)
    return by_lower[found[0]] if found else None


def choice(word: Any, allowed: Sequence[str]) -> str:
    """`did you mean 'a'? Allowed: a, b` for an unknown key, name or option."""
    near = nearest(word, allowed)
    hint = f"did you mean '{near}'? Allowed" if near else "allowed"
    return f"{hint}: {', '.join(allowed) or 'none'}"


class ContactError(RuntimeError):
    """A contact cannot act as the scene asks, or something has passed through it; raised on all ranks alike."""


class WaterError(RuntimeError):
    """Water cannot flow as the scene asks; raised on all ranks alike."""


def place_text(place, origin, digits: int) -> str:
    """A place (d,) m that is counted from `origin`, as text for people, with `digits` digits and those of `origin`."""
    texts = (f"{x:.{digits}g}" if not o else f"{o + x:.{digits + 6}g}" for x, o in zip(place, origin, strict=True))
    return ", ".join(texts)
