"""YAML text to data with lines: what is read, and what is refused with which message."""

import os

import pytest
import yaml

from periporo.errors import SCREEN_LINES, InputError
from periporo.io.input.yaml_source import MAX_BYTES, parse_yaml, read_yaml


@pytest.fixture(autouse=True, params=["CSafeLoader", "SafeLoader"])
def parser(request, monkeypatch):
    """Every test with both of PyYAML's parsers; not every installation has the fast one."""
    monkeypatch.setattr("periporo.io.input.yaml_source._LOADER", getattr(yaml, request.param))


def refusal(text):
    with pytest.raises(InputError) as caught:
        parse_yaml(text, "scene.yaml")
    return caught.value


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e7", 1e7),
        ("-2E-3", -2e-3),
        ("+.5", 0.5),
        ("5.", 5.0),
        ("010", 10),
        ("12:30", "12:30"),
        ("2024-01-02", "2024-01-02"),
        ("yes", True),
        ("Off", False),
        ("~", None),
        ("1_000", "1_000"),
        ("0x10", "0x10"),
        ("'1e7'", "1e7"),
        ("|\n  two\n  lines\n", "two\nlines\n"),
        ("-.inf", -float("inf")),
        ("9" * 30, 1e30),
    ],
)
def test_plain_scalars(text, value):
    read = parse_yaml(f"a: {text}").data["a"]
    assert read == value and type(read) is type(value)


def test_not_a_number_is_read_as_such():
    value = parse_yaml("a: .nan").data["a"]
    assert value != value


def test_keys_are_text_whatever_they_look_like():
    assert parse_yaml("yes: 1\n2: 3\nnull: 4").data == {"yes": 1, "2": 3, "null": 4}


def test_lines_of_keys_and_entries():
    source = parse_yaml("a: 1\nb:\n  - c: 2\n\n    d:\n      5\n  - 7\n")
    assert source.data == {"a": 1, "b": [{"c": 2, "d": 5}, 7]}
    lines = {("a",): 1, ("b",): 2, ("b", 0): 3, ("b", 0, "d"): 5, ("b", 1): 7}
    assert {path: source.line(path) for path in lines} == lines
    assert source.line(("b", 0, "missing", "below")) == 3


def test_aliases_repeat_values():
    source = parse_yaml("a: &x {k: [1, 2]}\nb: *x\nc: &n 3\nd: *n")
    assert source.data == {"a": {"k": [1, 2]}, "b": {"k": [1, 2]}, "c": 3, "d": 3}


BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)


@pytest.mark.parametrize(
    ("text", "line", "says"),
    [
        ("", None, "empty"),
        ("# nothing\n", None, "empty"),
        ("a: [1, 2\nb: 3\n", 2, "not valid YAML"),
        ("a:\n\tb: 1\n", 2, "spaces, not tabs"),
        ("a: {b: 1\n", 1, "while parsing a flow mapping"),
        ("a: 'open\n", 1, "not valid YAML"),
        ("a: 1\n---\nb: 2\n", 2, "second document"),
        ("a: !!python/object/apply:os.system ['true']\n", 1, "tags such as !!python"),
        ("a: 1\nb: !!float 3\n", 2, "tags"),
        ("a: 1\n? [b, c]\n: 2\n", 2, "key must be plain text"),
        ("a: &k b\n*k : 2\n", 2, "alias"),
        ("a: *nowhere\n", 1, "nowhere"),
        ("a: &x [1, *x]\n", 1, "inside of what it repeats"),
        ("a: " + "[" * 100_000, 1, "levels deep"),
        ("a: " + "{b: " * 50 + "1" + "}" * 50, 1, "levels deep"),
        ("a: &d " + "[" * 30 + "]" * 30 + "\nb: " + "[" * 20 + "*d" + "]" * 20, 2, "levels deep"),
        (BOMB, 5, "aliases repeat"),
        ("a: 1\nb: \x07\n", 2, "U+0007 is not allowed in YAML"),
    ],
)
def test_refused_with_line_and_reason(text, line, says):
    error = refusal(text)
    assert says in error.problems[0].message
    assert [p.line for p in error.problems] == [line]
    assert len(str(error).splitlines()) <= SCREEN_LINES


def test_duplicate_keys_name_both_lines_and_leave_the_rest_readable():
    source = parse_yaml("a: 1\nb:\n  - c: 1\n    c: 2\na: 3\n")
    assert [(p.path, p.line) for p in source.problems] == [(("b", 0, "c"), 4), (("a",), 5)]
    assert "line 1" in source.problems[1].message


def test_read_yaml_reads_a_file_with_a_byte_order_mark(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_bytes(b"\xef\xbb\xbftitle: d\xc3\xbcne\n")
    assert read_yaml(file).data == {"title": "düne"}


def test_files_that_cannot_be_read(tmp_path):
    latin, large, pipe = tmp_path / "latin.yaml", tmp_path / "large.yaml", tmp_path / "pipe.yaml"
    latin.write_bytes(b"a: 1\nb: \xfc\n")
    large.write_bytes(b"#" * (MAX_BYTES + 1))
    os.mkfifo(pipe)
    cases = {
        tmp_path / "none.yaml": "no such file",
        tmp_path: "folder",
        latin: "line 2: the file is not UTF-8",
        large: "larger than 5 MB",
        pipe: "not a regular file",
        tmp_path / ("x" * 300): "cannot be read",
        "a\0b": "cannot be read",
    }
    for path, says in cases.items():
        with pytest.raises(InputError) as caught:
            read_yaml(path)
        assert says in str(caught.value)
        assert "\0" not in str(caught.value)
