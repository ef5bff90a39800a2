"""YAML text to plain data that remembers its lines.

The data come straight from the parser's events, so that nesting, aliases, tags, duplicate keys and plain
numbers are under our control: `1e7` is a number, `010` is ten, `12:30` and dates are text.
"""

import re
import stat
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from periporo.errors import InputError, Problem, shorten

MAX_BYTES = 5_000_000
_MAX_DEPTH = 40
_MAX_ALIASED_NODES = 10_000  # nodes that aliases may add: plenty for reuse, too few for a bomb

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the same events, ten times faster
_INTEGER = re.compile(r"[-+]?[0-9]+")
_REAL = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_SPECIAL_REAL = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")
_BOOLEANS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


@dataclass
class _Node:
    """A value with the line where it starts, and the lines of its keys."""

    value: Any
    line: int
    children: dict[str | int, "_Node"] = field(default_factory=dict)
    key_lines: dict[str | int, int] = field(default_factory=dict)
    anchor: str | None = None
    size: int = 1  # nodes, this one and those below
    height: int = 1  # levels, this one and those below


class YamlSource:
    """Data read from YAML: `data`, the `name` of its file, and the line of every key.

    `problems` holds what is wrong without making the rest unreadable (duplicate keys).
    """

    def __init__(self, name: str, root: _Node, problems: list[Problem]):
        self.name = name
        self.data = root.value
        self.problems = problems
        self._root = root

    def line(self, path: tuple[str | int, ...]) -> int:
        """The line, from 1, of the key or list entry at `path`, or of the deepest part of it that exists."""
        node, line = self._root, self._root.line
        for part in path:
            if part not in node.children:
                break
            line = node.key_lines.get(part, node.children[part].line)
            node = node.children[part]
        return line


def read_yaml(path: str | Path) -> YamlSource:
    """Read the YAML file at `path`. Raises InputError if it cannot be read or is not plain YAML."""
    return parse_yaml(_read_text(str(path)), str(path))


def _read_text(name: str) -> str:
    try:
        mode = Path(name).stat().st_mode
        if stat.S_ISDIR(mode):
            raise _failure(name, "this is a folder; give the name of a scene file (.yaml)")
        if not stat.S_ISREG(mode):
            raise _failure(name, "this is not a regular file; give the name of a scene file (.yaml)")
        with open(name, "rb") as file:
            raw = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise _failure(name, "there is no such file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise _failure(name, f"the file cannot be read: {reason}") from None
    if len(raw) > MAX_BYTES:
        message = f"the file is larger than {MAX_BYTES // 10**6} MB; put points into a file of their own"
        raise _failure(name, message)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise _failure(name, "the file is not UTF-8 text; save it as UTF-8", line) from None


def parse_yaml(text: str, name: str = "<text>") -> YamlSource:
    """Turn YAML `text` into data; `name` stands for the file in messages. Raises InputError."""
    builder = _Builder(name)
    try:
        for event in yaml.parse(text, Loader=_LOADER):
            builder.accept(event)
    except yaml.MarkedYAMLError as error:
        raise _syntax_failure(name, text, error) from None
    except yaml.reader.ReaderError as error:
        line = text[: error.position].count("\n") + 1
        code = error.character if isinstance(error.character, int) else ord(error.character)
        message = f"the character U+{code:04X} is not allowed in YAML"
        raise _failure(name, message, line) from None
    if builder.root is None or builder.root.value is None:
        raise _failure(name, "the file is empty; see `periporo schema` for what a scene contains")
    return YamlSource(name, builder.root, builder.problems)


def _failure(name: str, message: str, line: int | None = None) -> InputError:
    return InputError(name, [Problem((), message, line)])


def _syntax_failure(name: str, text: str, error: yaml.MarkedYAMLError) -> InputError:
    message, line = f"not valid YAML: {error.problem}", None
    if "nesting depth" in (error.problem or ""):  # the parser has a limit of its own, which may be the lower one
        message = f"nested more than {_MAX_DEPTH} levels deep"
    if error.context and error.context_mark:
        message += f" ({error.context} that starts in line {error.context_mark.line + 1})"
    if error.problem_mark:
        lines = text.splitlines() or [""]
        line = min(error.problem_mark.line + 1, len(lines))
        if "\t" in lines[line - 1][: error.problem_mark.column + 1]:
            message += "; indent with spaces, not tabs"
    return _failure(name, message, line)


class _Builder:
    """Builds the tree of nodes from parser events, without recursion."""

    def __init__(self, name: str):
        self.name = name
        self.root: _Node | None = None
        self.problems: list[Problem] = []
        self._open: list[_Node] = []
        self._keys: list[str | None] = []  # for every open collection, the key that awaits its value
        self._path: list[str | int] = []
        self._anchors: dict[str, _Node | None] = {}
        self._aliased = 0

    def accept(self, event: yaml.Event) -> None:
        line = event.start_mark.line + 1 if event.start_mark else 1
        match event:
            case yaml.ScalarEvent():
                self._refuse_tag(event, line)
                self._scalar(event, line)
            case yaml.MappingStartEvent() | yaml.SequenceStartEvent():
                self._refuse_tag(event, line)
                self._begin({} if isinstance(event, yaml.MappingStartEvent) else [], event.anchor, line)
            case yaml.MappingEndEvent() | yaml.SequenceEndEvent():
                self._end()
            case yaml.AliasEvent():
                self._alias(event.anchor, line)
            case yaml.DocumentStartEvent() if self.root is not None:
                raise _failure(self.name, "a second document ('---') starts here; keep one", line)

    def _refuse_tag(self, event: yaml.NodeEvent, line: int) -> None:
        if event.tag is not None:
            tag = event.tag.replace("tag:yaml.org,2002:", "!!")
            message = f"tags such as {shorten(tag, 40)} are not allowed; write the plain value"
            raise _failure(self.name, message, line)

    def _scalar(self, event: yaml.ScalarEvent, line: int) -> None:
        if self._awaits_key():
            self._take_key(event.value, line)
            return
        value = _plain_value(event.value) if event.style in (None, "") else event.value
        node = _Node(value, line)
        if event.anchor:
            self._anchors[event.anchor] = node
        self._attach(node)

    def _awaits_key(self) -> bool:
        return bool(self._open) and isinstance(self._open[-1].value, dict) and self._keys[-1] is None

    def _take_key(self, key: str, line: int) -> None:
        mapping = self._open[-1]
        if key in mapping.key_lines:
            message = f"this key stands here twice, first in line {mapping.key_lines[key]}; keep one"
            self.problems.append(Problem((*self._place(), key), message, line))
        mapping.key_lines.setdefault(key, line)
        self._keys[-1] = key

    def _place(self) -> tuple[str | int, ...]:
        """Path of the collection that is open."""
        return tuple(
            str(key) if isinstance(parent.value, dict) else len(parent.value)
            for parent, key in zip(self._open[:-1], self._keys[:-1], strict=True)
        )

    def _begin(self, value: dict | list, anchor: str | None, line: int) -> None:
        if self._awaits_key():
            raise _failure(self.name, "a key must be plain text, not a list or a mapping", line)
        self._check_depth(1, line)
        node = _Node(value, line, anchor=anchor)
        if anchor:
            self._anchors[anchor] = None  # until it is complete
        self._open.append(node)
        self._keys.append(None)

    def _end(self) -> None:
        node = self._open.pop()
        self._keys.pop()
        if node.anchor:
            self._anchors[node.anchor] = node
        self._attach(node)

    def _check_depth(self, height: int, line: int) -> None:
        if len(self._open) + height > _MAX_DEPTH:
            raise _failure(self.name, f"nested more than {_MAX_DEPTH} levels deep", line)

    def _alias(self, anchor: str, line: int) -> None:
        if self._awaits_key():
            raise _failure(self.name, "a key must be plain text, not an alias", line)
        if anchor not in self._anchors:
            raise _failure(self.name, f"the alias *{anchor} has no anchor &{anchor} above it", line)
        node = self._anchors[anchor]
        if node is None:
            raise _failure(self.name, f"the alias *{anchor} stands inside of what it repeats", line)
        self._check_depth(node.height, line)
        self._aliased += node.size
        if self._aliased > _MAX_ALIASED_NODES:
            message = f"aliases repeat more than {_MAX_ALIASED_NODES} values; write out what is needed"
            raise _failure(self.name, message, line)
        self._attach(node)

    def _attach(self, node: _Node) -> None:
        if not self._open:
            self.root = node
            return
        parent = self._open[-1]
        parent.size += node.size
        parent.height = max(parent.height, node.height + 1)
        part: str | int
        if isinstance(parent.value, dict):
            part = str(self._keys[-1])
            self._keys[-1] = None
            parent.value[part] = node.value
        else:
            part = len(parent.value)
            parent.value.append(node.value)
        parent.children[part] = node


def _plain_value(text: str) -> Any:
    """The value of an unquoted scalar."""
    if text in ("", "~", "null", "Null", "NULL"):
        return None
    if text in (text.lower(), text.title(), text.upper()) and text.lower() in _BOOLEANS:
        return _BOOLEANS[text.lower()]
    if _INTEGER.fullmatch(text) and len(text) < 20:
        return int(text)
    if _REAL.fullmatch(text):
        return float(text)
    if _SPECIAL_REAL.fullmatch(text):
        return float(text.replace(".", ""))
    return text
