"""Zhang's experiments: every printed figure has its row and a verdict, and every picture is drawn."""

import json

import numpy as np
import pytest

from fg_nav.lab.reproduce import aiez2017
from fg_nav.lab.reproduce.aiez2017 import NEAR, magnet_part
from fg_nav.lab.reproduce.results import MISSED_EXPLAINED, REPRODUCED
from fg_nav.lab.reproduce.runner import run_paper
from fg_nav.text import to_json
from tests.lab.reproduce.stored_walks import check_pictures, keys_of_paper, rows_of, store_walks
from tests.pictures import sketch_pictures

SEEDS = (101, 102)
TABLE_1 = {"iez:as-printed": 9.49, "qsf-stance:as-printed": 3.0, "aiez:as-printed": 2.0}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("aiez2017")


@pytest.fixture(scope="module")
def found(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(aiez2017, "CORRIDORS", 1)
        sketch_pictures(patch)
        store_walks(folder, keys_of_paper("aiez2017", SEEDS), lambda key: TABLE_1.get(key.method, 0.5))
        (folder / "pictures").mkdir()
        return run_paper("aiez2017", folder, SEEDS, 1, lambda _: None, False)


def test_every_experiment_is_there_every_figure_is_drawn_and_table_1_has_its_verdicts(found, folder):
    assert [one.name for one in found.experiments] == ["Z-E1", "Z-E2"]
    check_pictures(found, folder, [6, 7])
    rows = rows_of(found)
    assert rows["Z-E2: position error, IEZ"].verdict == REPRODUCED
    assert rows["Z-E2: position error, IEZ + classical QMD, between"].verdict == MISSED_EXPLAINED
    assert rows["Z-E2: position error, AIEZ, between"].verdict == MISSED_EXPLAINED
    assert rows["Z-E2: position error, AIEZ, indoor"].verdict == ""  # one floor is the paper's
    assert rows["Z-E2: TTD error, AIEZ, between"].ours["as printed"].median == pytest.approx(0.2)


def test_beside_ten_magnets_the_classical_detector_accepts_and_the_proposed_does_not(found, folder):
    rows = rows_of(found)
    assert rows["Z-E1: near accepted, classical QMD, ten magnets"].verdict == REPRODUCED
    proposed = rows["Z-E1: near accepted, proposed, ten magnets"].ours
    assert proposed["physical"].median < 0.2 < proposed["as printed"].median
    area = rows["Z-E1: near distinguished from far (area under the ROC), ten magnets"].ours
    assert area["classical"].median < 0.8 < area["physical"].median
    # the footfalls that are turned are those beside the magnet
    walk = magnet_part(10, SEEDS[0]).load(folder)
    near = walk["turned_deg"] > NEAR[0]
    assert (np.linalg.norm(walk["place"] - walk["magnet"][:2], axis=1)[near] < 1.5).all()
    assert rows["Z-E1: footfalls near, all walks, ten magnets"].ours["physical"].median == near.sum()
    assert np.abs(walk["place"][:, 0]).max() < 3.0


def test_parameters_are_those_of_walks_and_detectors_too(found):
    assert "0x" not in json.dumps(to_json(found.parameters))  # a place in memory would be another in each run
    assert found.parameters["scenario magnet-corridor"]["magnets"]
    assert not found.parameters["scenario teaching-building"]["magnets"]
    assert {"field between", "field indoor", "detector qsf-stance"} <= set(found.parameters)
