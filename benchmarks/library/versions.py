"""Versions of the program side by side: commits laid out in folders of their own, each with a process that runs it."""

import io
import json
import os
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

from .. import ROOT

WORKLOAD = Path(__file__).with_name("workload.py")
CHECKOUT = "checkout"  # names the files as they are, with what is not committed


class VersionError(Exception):
    """There is no such version, or it does not run."""


def git(*words: str) -> bytes:
    """What git says of this checkout. Raises VersionError."""
    done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True)
    if done.returncode:
        raise VersionError(done.stderr.decode().strip())
    return done.stdout


def name_of(version: str) -> str:
    """The short name of a commit, or that of the checkout. Raises VersionError."""
    if version == CHECKOUT:
        return CHECKOUT
    return git("rev-parse", "--short", "--verify", f"{version}^{{commit}}").decode().strip()


def lay_out(version: str, folder: Path) -> Path:
    """A folder for PYTHONPATH where `periporo` is this version, with entry points of its own. Raises VersionError."""
    folder.mkdir()
    if version == CHECKOUT:
        (folder / "periporo").symlink_to(ROOT)
    else:
        with tarfile.open(fileobj=io.BytesIO(git("archive", version))) as files:
            files.extractall(folder / "periporo", filter="data")
    project = tomllib.loads((folder / "periporo" / "pyproject.toml").read_text())["project"]
    info = folder / f"periporo-{project['version']}.dist-info"  # found before that of an installed version
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: periporo\nVersion: {project['version']}\n")
    groups = project.get("entry-points", {})
    lines = [f"[{group}]\n" + "\n".join(f"{k} = {v}" for k, v in names.items()) for group, names in groups.items()]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")
    return folder


class Process:
    """A process that measures a version; it does nothing between questions. A context, which ends it."""

    def __init__(self, folder: Path):
        environment = os.environ | {"PYTHONPATH": str(folder), "PERIPORO_CACHE": str(folder / "cache"),
                                    "PYTHONDONTWRITEBYTECODE": "1"}  # fmt: skip
        self._process = subprocess.Popen([sys.executable, "-P", str(WORKLOAD)], env=environment, text=True,
                                         stdin=subprocess.PIPE, stdout=subprocess.PIPE)  # fmt: skip
        self._place = folder / "periporo" / "__init__.py"

    def __enter__(self):
        place = self._answer()
        if Path(place) != self._place:
            raise VersionError(f"measures {place}, not {self._place}")
        return self

    def __exit__(self, *problem):
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()

    def ask(self, name: str) -> None:
        """Begin to measure; the answer is to be fetched."""
        self._process.stdin.write(f"{name}\n")
        self._process.stdin.flush()

    def _answer(self):
        line = self._process.stdout.readline()
        if not line:
            raise VersionError(f"{self._place.parent}: its process has ended; what it said is above")
        return json.loads(line)

    def seconds(self) -> dict[str, float]:
        """The answer: seconds by measurement; none if this version cannot run what was asked."""
        found = self._answer()
        if "error" in found:
            print(f"{self._place.parent.parent.name}: {found['error']}", file=sys.stderr)
            return {}
        return found

    def measure(self, name: str) -> dict[str, float]:
        """Ask, and wait for the answer."""
        self.ask(name)
        return self.seconds()
