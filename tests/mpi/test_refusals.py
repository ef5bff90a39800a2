"""Bad input on the command line: refused on one screen, on one rank and on two alike, and nothing is written."""

import json
from collections import Counter
from importlib import resources
from pathlib import Path

import pytest

from periporo.errors import SCREEN_LINES, SCREEN_WIDTH

SHARE = 5  # of the scenes that one rank refuses, two ranks are given every fifth


@pytest.fixture(scope="module")
def answers(launch, tmp_path_factory):
    """What the command line answers to damaged scenes, on one rank and on two: see refusals.py."""
    parent, found = tmp_path_factory.mktemp("answers"), []
    for ranks, share in ((1, 1), (2, SHARE)):
        folder = parent / f"ranks{ranks}"
        folder.mkdir()
        run = launch(ranks, "refusals", "answers.json", share, folder=folder)
        assert run.returncode == 0, run.stderr
        found.append(json.loads((folder / "answers.json").read_text().replace(folder.name, "ranks")))
    return found


def test_every_damaged_scene_is_refused_on_one_screen(answers):
    for what, statuses, outputs, errors, files in answers[0]:
        lines = errors[0].splitlines()
        assert statuses == [2] and outputs == [""] and files == [], f"{what}: {statuses} {outputs} {errors} {files}"
        assert 1 <= len(lines) <= SCREEN_LINES and max(map(len, lines)) <= SCREEN_WIDTH + len("periporo: "), what
        assert errors[0].startswith("periporo: scene.yaml: ") or "scene: 1 problem" in lines[0], errors[0]
        assert not any(word in errors[0] for word in ("Traceback", "pydantic", "Input should")), errors[0]


def test_two_ranks_answer_the_same_with_one_voice(answers):
    one, two = answers
    assert len(two) > 80
    for alone, together in zip(one[::SHARE], two, strict=True):
        what, statuses, outputs, errors, files = together
        assert alone[0] == what and statuses == [2, 2] and outputs == ["", ""] and files == [], what
        assert errors == [alone[3][0], ""], what


def test_each_shipped_scene_was_damaged_in_its_share_of_the_ways(answers):
    counts = Counter(what.split(":")[0] for what, *_ in answers[0])
    shipped = [path.stem for path in Path(resources.files("periporo.configs")).glob("*.yaml")]
    assert sorted(counts) == sorted(shipped)
    assert sum(counts.values()) > 400 and min(counts.values()) > 0.7 * max(counts.values())
    assert len({what for what, *_ in answers[0]}) > 0.9 * len(answers[0])
