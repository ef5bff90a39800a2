"""Two materials bonded to each other, one of them Arena: the same bits on one and on two ranks."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from mpi4py import MPI

from periporo.core.bonds.rows import BOTH, FIRST, SECOND
from periporo.core.scene.build import build
from periporo.io.input.load import load_scene, parse_scene
from periporo.io.input.yaml_source import read_yaml
from periporo.io.output.results import open_results

SCENE = Path(__file__).parents[2] / "configs" / "arena_on_bedrock.yaml"


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """The file of the shipped scene at twice the spacing and a third of the time."""
    scene = read_yaml(SCENE).data
    scene["spacing"] = 0.1
    scene["stages"][2]["duration"] = 2e-3
    scene["boundaries"]["base"]["where"]["upper"] = [None, 0.1]
    scene["boundaries"]["blast"]["where"] = {"lower": [-0.2, 1.4], "upper": [0.2, None]}
    file = tmp_path_factory.mktemp("scene") / "coarse.yaml"
    file.write_text(yaml.safe_dump(scene))
    return file


def test_shipped_scene_is_valid():
    scene = load_scene(SCENE)
    assert {m.model for m in scene.materials.values()} == {"arena", "elastic"}


def test_both_laws_act_in_the_bonds_across_the_interface(coarse):
    sim = build(parse_scene(read_yaml(coarse).data | {"correspondence": "bond_projected"}), MPI.COMM_SELF)
    sim.start()
    rock, sand = sim.bonds.blocks
    across = [set(b.pair[b.side != BOTH].tolist()) for b in (rock, sand)]
    assert across[0] == across[1] and len(across[0]) > 60
    assert {FIRST, SECOND} == set(rock.side[rock.side != BOTH]) | set(sand.side[sand.side != BOTH])
    assert (sand.state[sand.active, 2] < 0).all()  # strength of every row, also across


def test_blast_on_two_ranks_has_the_same_bits_and_crushes_the_sand(launch, tmp_path, coarse, datasets,
                                                                     assert_same_bits):  # fmt: skip
    files = []
    for ranks in (1, 2):
        folder = tmp_path / str(ranks)
        folder.mkdir()
        shutil.copy(coarse, folder / "scene.yaml")
        finished = launch(ranks, "folders", "--quiet", "--no-plot", folder=folder)
        assert finished.returncode == 0, finished.stderr
        files.append(folder / "scene.vtkhdf")
    assert_same_bits(*map(datasets, files))
    with open_results(files[1]) as results:
        assert results.attributes["ranks"] == 2 and results.attributes["messages"] > 0
        sand = results.field("material") == 1
        compaction, pressure = results.field("volumetric_plastic_strain"), results.field("pore_pressure")
        speed = np.abs(results.field("velocity")[:, 1])
    assert compaction[sand].max() > 1e-2 and pressure[sand].max() > 1e3
    assert not compaction[~sand].any() and not pressure[~sand].any()
    assert speed[~sand].max() > 1e-3  # the pulse has gone into the rock
