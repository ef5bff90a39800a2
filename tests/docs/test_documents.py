"""Every command and snippet in README.md and the pages of docs is tried, so that none can go stale.

Fenced blocks are carried out in order, a folder for each page. Scenes are run at reduced size: spacing doubled where
every box stays at least 16 points wide, stages of motion cut to 0.5 ms and of flow in equilibrium to 1 s, relaxation
ended early, mpirun starts one rank.
Not carried out but checked are commands of the shell that install, batch systems, benchmarks and tests: packages'
extras, scripts, their options and the tests' names must exist. Commands within a text are checked in the same way, or
parsed if they are periporo's own. A comment `<!-- file: NAME -->` before a fence saves the block under this name.
"""

import importlib
import re
import shlex
import subprocess
import sys
import tomllib
from contextlib import redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path

import pytest
import yaml

from benchmarks.__main__ import benchmarks
from periporo.core import cli
from periporo.core.motion.dissipation import PlasticDissipation
from periporo.core.points import fields
from periporo.core.points.fields import StrainMeasures
from periporo.core.points.forces import WORK
from periporo.core.watch.observers import HistoryObserver
from periporo.core.water.pore_water import PoreWater
from periporo.io.input.load import load_scene, parse_scene
from periporo.io.input.yaml_source import parse_yaml
from periporo.io.schema.scene import SceneInput
from periporo.materials import read_test

ROOT = Path(__file__).parents[2]
ROOMS = ("core", "io", "materials", "contact", "benchmarks", "tests")
FIGURES = ROOT / "docs" / "figures"  # made by benchmarks
FRONT = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
PAGES = [*FRONT, *sorted(page for page in (ROOT / "docs").rglob("*.md") if FIGURES not in page.parents)]
FENCE = re.compile(
    r"(?:^ *<!-- file: (?P<file>\S+) -->\n)?^(?P<indent> *)```(?P<language>[\w{}-]*)\n(?P<text>.*?)^ *```$", re.M | re.S
)
INLINE = re.compile(r"`((?:python|pytest|mpirun|periporo|pip|sphinx-build) [^`\n]+)`")
NO_CODE = ("", "text", "{include}", "{toctree}", "{eval-rst}")
STEP = 5e-4  # s, of a stage at reduced size


def identity(page):
    return str(page.relative_to(ROOT))


def blocks(page):
    """(file to save it in or None, language, text) of each fenced block of a page."""
    for match in FENCE.finditer(page.read_text()):
        text = re.sub(rf"^{match['indent']}", "", match["text"], flags=re.M)
        yield match["file"], match["language"], text


def commands(text):
    """The commands of a block of shell, without comments and with lines that are continued joined."""
    for line in text.replace("\\\n", " ").splitlines():
        line = re.sub(r"\s+#.*", "", line)
        for part in line.split("&&"):
            words = shlex.split(part, comments=True)
            if words:
                yield part.strip(), words


def reduce(path):
    """Make a scene small enough for a test, keeping everything that is not size or duration."""
    scene = yaml.safe_load(path.read_text())
    if not isinstance(scene, dict) or "stages" not in scene:
        return
    full = load_scene(path)
    sides = [
        u - v for b in full.bodies if b.shape.type == "box" for u, v in zip(b.shape.upper, b.shape.lower, strict=True)
    ]
    if sides and min(sides) >= 32 * full.spacing:
        scene["spacing"] = 2 * full.spacing
    for stage in scene["stages"]:
        if stage["type"] == "dynamics":
            stage["duration"] = min(float(stage["duration"]), STEP)
        elif stage["type"] == "relax":
            stage["tolerance"] = 0.01
        elif stage["type"] == "quasi_static":
            stage |= {"duration": min(float(stage["duration"]), 1.0), "tolerance": 0.01}
        else:
            stage |= {"trial": 0.5, "accuracy": 0.3}
    scene["output"] = dict(scene.get("output", {})) | {"interval": STEP / 4}
    path.write_text(yaml.safe_dump(scene, sort_keys=False))


class Page:
    """Carries out the blocks of a page in a folder."""

    def __init__(self, folder, install):
        self.folder, self.install = folder, install
        self.names, self.reduced = {"__name__": "snippet"}, set()

    def carry_out(self, file, language, text):
        """Save a block, or do what it says."""
        if file:
            (self.folder / file).write_text(text)
        match language:
            case "yaml":
                self.yaml(file, text)
            case "csv":
                assert file, "a table that is not saved"
            case "toml":
                tomllib.loads(text)
            case "python":
                text = re.sub(r'(?<="duration": )[\d.e-]+', "0.0035", text)
                exec(compile(text, file or "<snippet>", "exec"), self.names)
            case "sh":
                for line, words in commands(text):
                    self.shell(line, words)
                    self.make_small()
            case _:
                raise AssertionError(f"a block in an unknown language, {language!r}: say what to do with it here")
        self.make_small()

    def make_small(self):
        """Bring new scenes in the folder to a test's size."""
        for scene in set(self.folder.glob("*.yaml")) - self.reduced:
            reduce(scene)
            self.reduced.add(scene)

    def yaml(self, file, text):
        """A scene is checked; part of one is put into a scene that lacks it; a law needs its keys."""
        data = parse_yaml(text).data
        if "dimension" in data:
            parse_scene(data)
        elif "phases" in data:
            read_test(data)
        elif not {"model", "variants", "tests"} & set(data):
            assert set(data) <= set(SceneInput.model_fields), data
            if set(data) & {"checkpoint", "correspondence", "output", "monitor", "time_step"} == set(data):
                parse_scene(SCENE | data)

    def shell(self, line, words):
        """One command, without variables that are set for it alone."""
        while re.match(r"[A-Z_\d]+=", words[0]):
            words = words[1:]
        words = [Path(words[0]).name, *words[1:]]
        if words[0] == "mpirun" and words[3] == "periporo":
            words = words[3:]
        if words[0] == "periporo":
            self.periporo(line, words[1:])
        elif words[0] == "sed":
            subprocess.run(line, shell=True, check=True, cwd=self.folder)
        elif words[0] == "pip" and words[-2:] == ["-e", "."]:  # a package that the page has made
            self.install(self.folder)
        else:
            check(words)

    def provide(self, words):
        """Inputs that a page takes for granted: a small scene, a law, a path."""
        for word in words if words[0] != "new" else ():
            if word.endswith(".yaml") and not Path(word).exists():
                given = SCENE if words[0] != "drive" else LAW if word == words[1] else TEST
                Path(word).write_text(yaml.safe_dump(given))
            elif word.endswith(".csv") and not Path(word).exists():
                Path(word).write_text("time_s,strain_yy\n0,0\n1,-0.01\n")

    def periporo(self, line, words):
        """In this process; a run that the page has made already is made anew."""
        self.provide(words)
        if words[0].endswith(".yaml") and Path(words[0]).with_suffix(".vtkhdf").exists() and "--resume" not in words:
            words = [*words, "--overwrite"]
        assert cli.main(words) == 0, line


TEST = {"phases": [{"type": "isotropic", "stress": 1e5}]}
LAW = {"model": "elastic", "density": 1760, "bulk_modulus": 25e6, "shear_modulus": 15e6}
SCENE = {
    "dimension": 2, "spacing": 0.01, "gravity": [0, -9.81],
    "materials": {"soil": LAW},
    "bodies": [{"name": "b", "material": "soil", "shape": {"type": "box", "lower": [0, 0], "upper": [0.1, 0.05]}}],
    "stages": [{"name": "fall", "type": "dynamics", "duration": 1e-3}],
}  # fmt: skip


def check(words):
    """A command that is not carried out: what it names must exist."""
    first = Path(words[0]).name
    if first in ("source", "module", "export", "sbatch", "sphinx-build", "pre-commit"):
        return
    assert first in CHECKS, f"an unknown command: {' '.join(words)}; say what to do with it here"
    CHECKS[first](words)


def check_python(words):
    """A benchmark must exist and know the options; code must compile; a script without a folder is the reader's."""
    if "-c" in words:
        compile(words[words.index("-c") + 1], "<command>", "exec")
    elif words[1:3] == ["-m", "benchmarks"]:
        known = help_of(words[3]) if len(words) > 3 else ""
        for option in (w.split("=")[0] for w in words if w.startswith("--")):
            assert option in known, f"the benchmark {words[3]} has no option {option}"
    elif words[1].endswith(".py"):
        assert "/" not in words[1] or (ROOT / words[1]).exists(), f"{words[1]} does not exist"
    else:
        assert words[1:3] == ["-m", "venv"], f"nothing is known of: {' '.join(words)}"


def check_pip(words):
    """Extras must be offered."""
    offered = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for extras in re.findall(r"\.\[([\w,]+)\]", " ".join(words)):
        assert set(extras.split(",")) <= set(offered), words


def check_pytest(words):
    """Files must exist, and hold a test that -k chooses."""
    chosen = words[words.index("-k") + 1] if "-k" in words else None
    for file in (ROOT / word.split("::")[0] for word in words[1:] if word.startswith("tests")):
        assert file.exists(), f"{file} does not exist"
        if chosen and file.is_file():
            assert re.search(rf"def test_\w*{chosen}|[\"']{chosen}", file.read_text()), f"no test: {words}"


def check_launched(words):
    """What srun or mpirun starts."""
    program = next((k for k, word in enumerate(words) if word in ("periporo", "python")), None)
    if program is not None:
        check(words[program:])


CHECKS = {"python": check_python, "pip": check_pip, "pytest": check_pytest, "mpirun": check_launched,
          "srun": check_launched, "periporo": lambda words: parse_own(words[1:])}  # fmt: skip


def parse_own(words):
    """A command of periporo's own must be one that its parser takes; a word alone must be one of its words."""
    if words[0].isupper() or (len(words) == 1 and words[0] in (*cli.TOOLS, "run", "check")):
        return
    words = words if words[0] in (*cli.TOOLS, "run", "check") else ["run", *words]
    try:
        cli._parser(words[0]).parse_args([w for w in words if w != ">" and not w.endswith(".json")])
    except SystemExit as stop:
        raise AssertionError(f"periporo does not take: {' '.join(words)}") from stop


@cache
def help_of(benchmark):
    """What a benchmark says of its options."""
    assert benchmark in benchmarks(), f"there is no benchmark {benchmark}"
    with redirect_stdout(StringIO()) as said, pytest.raises(SystemExit):
        importlib.import_module(f"benchmarks.{benchmark}").main(["--help"])
    return said.getvalue()


@pytest.fixture
def install(tmp_path_factory, monkeypatch):
    """The function that installs the package in a folder where this process and its children find it."""

    def perform(folder):
        target = tmp_path_factory.mktemp("site")
        pip = [sys.executable, "-m", "pip", "install", "--no-deps", "--no-build-isolation", "--no-index", "--quiet"]
        subprocess.run([*pip, "--target", str(target), str(folder)], check=True, timeout=120)
        monkeypatch.syspath_prepend(str(target))

    return perform


@pytest.mark.parametrize("page", PAGES, ids=identity)
def test_blocks(page, tmp_path, monkeypatch, install):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    place = Page(tmp_path, install)
    for file, language, text in blocks(page):
        if language not in NO_CODE:
            place.carry_out(file, language, text)


@pytest.mark.parametrize("page", PAGES, ids=identity)
def test_commands_within_the_text(page):
    text = FENCE.sub("", page.read_text())
    for command in [*INLINE.findall(text), *re.findall(r"^ {4}\$ (.+)$", text, re.M)]:
        words = shlex.split(command)
        check([w for w in words if w not in ("N", "...")])


@pytest.mark.parametrize("page", PAGES, ids=identity)
def test_files_that_a_page_names_exist(page):
    """Paths of the source in code marks, and targets of links."""
    text = FENCE.sub("", page.read_text())
    for path in re.findall(r"`((?:core|io|materials|contact|benchmarks|tests|configs|docs)/[\w/.-]+)`", text):
        path = path.partition("NAME")[0]  # of a file that the reader is to make
        assert (ROOT / path).exists() or list(ROOT.glob(f"{path}*")), f"{path} does not exist"
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        assert (page.parent / target).exists(), f"the link to {target} leads nowhere"


def test_fences_without_a_language_hold_no_commands():
    for page in PAGES:
        for _, language, text in blocks(page):
            if language == "":
                assert not re.search(r"^(periporo|python|pip|pytest|mpirun) ", text, re.M), f"{page}: {text}"


@pytest.mark.parametrize("page", [*PAGES, *sorted(FIGURES.glob("*.md"))], ids=identity)
def test_pages_can_be_read(page):
    """Lines that fit a window, and no more of them than patience."""
    lines = page.read_text().splitlines()
    assert len(lines) <= 250, f"{page}: {len(lines)} lines; divide the page"
    for number, line in enumerate(lines, 1):
        assert len(line) <= 120, f"{page}, line {number}: {len(line)} characters; a table may need notes below it"


@pytest.mark.parametrize("page", [p for p in PAGES if p.parts[-2] in ("tutorials", "how-to", "explanation", "schemes")],
                         ids=identity)  # fmt: skip
def test_a_page_knows_its_reader(page):
    assert re.match(r"# .+\n\nFor \w+ |```\{include\}", page.read_text()), f"{page}: begin with 'For readers who ...'"


def test_every_page_is_in_the_table_of_contents():
    text = (ROOT / "docs" / "index.md").read_text()
    for page in PAGES[len(FRONT) :]:
        name = str(page.relative_to(ROOT / "docs").with_suffix(""))
        assert name == "index" or re.search(rf"^{re.escape(name)}$", text, re.M), f"docs/index.md lacks {name}"


def test_every_source_is_in_the_bibliography():
    """Whoever is cited in a document, a docstring or an example, as `A & B 2000` or `A et al. (2000)`."""
    entries = re.findall(r"^- \*\*(.+?)\.\*\*", (ROOT / "docs" / "reference" / "bibliography.md").read_text(), re.M)
    cited = re.compile(r"\b([A-Z][a-z]{2,})(?: et al\.| & [A-Z]\w+)?,? \(?((?:1[89]|20)\d\d)\b(?!-)")
    sources = [f for room in ROOMS for f in (ROOT / room).rglob("*.py")] + list((ROOT / "configs").rglob("*.yaml"))
    found = {}
    for source in [*PAGES, *sources]:
        text = re.sub(r"\n[\s#]*", " ", source.read_text())
        found |= {citation: source for citation in cited.findall(text)}
    missing = {c: str(s) for c, s in found.items() if not any(set(c) <= set(re.findall(r"\w+", e)) for e in entries)}
    assert len(found) > 20 and not missing


def test_the_version_is_the_same_everywhere():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == version
    assert re.search(rf"^## (Unreleased: )?{re.escape(version)}$", (ROOT / "CHANGELOG.md").read_text(), re.M)


def test_every_name_of_a_result_is_explained():
    text = (ROOT / "docs" / "reference" / "results.md").read_text()
    processes = (PlasticDissipation, PoreWater, StrainMeasures)
    names = {*fields.DEFAULT, *fields._PLAIN, *HistoryObserver.UNITS, *(name for p in processes for name in p.output)}
    names |= {f"{channel}_force" for channel in WORK if channel not in ("prescribed", "integration")}
    missing = {name for name in names if f"`{name}`" not in text}
    assert len(names) > 25 and not missing
