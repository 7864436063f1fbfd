"""Our figures beside those of Munoz Diaz et al. (2017): how they are read off a run, kept, and put together."""

import json
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fg_nav.frames import yaw_rotation
from fg_nav.lab.reproduce import munoz_diaz2017 as paper
from fg_nav.lab.reproduce.munoz_diaz2017 import Wanted, name_of
from fg_nav.lab.reproduce.munoz_diaz2017 import figures as pictures
from fg_nav.lab.reproduce.munoz_diaz2017 import runs as measures
from fg_nav.lab.reproduce.munoz_diaz2017.rows import PLAN
from fg_nav.lab.reproduce.munoz_diaz2017.runs import ESTIMATORS, Run, make_run
from fg_nav.lab.reproduce.munoz_diaz2017.text import TITLES
from fg_nav.lab.reproduce.munoz_diaz2017.walks import ALL, PUBLISHED, Setting, list_cases, read_setting
from fg_nav.lab.reproduce.results import write_reproduction
from fg_nav.lab.simulation import SCENARIOS, Choices, routes, simulate
from fg_nav.lab.simulation.path import straight
from fg_nav.pocket import PocketTrack
from tests.pictures import sketch_pictures

SHORT_M = 6.0


def run_with(minute, z=None, yaw=None):
    minute = np.asarray(minute, dtype=float)
    bias = np.zeros((len(minute), 3))
    bias[:, 2] = 0.0 if z is None else z
    yaw = np.zeros(len(minute)) if yaw is None else np.asarray(yaw, dtype=float)
    return Run(minute, bias, bias, yaw, None, np.zeros(len(minute), bool), np.zeros((1, 2)))


def setting_with(run, **columns):
    blank = Setting(*[np.zeros(1)] * 3, 1.0, np.zeros((1, 2)), np.zeros(4), np.zeros_like(run.bias))
    return replace(blank, **columns)


def true_track(recording, turning=0.0):
    """The truth as an estimate, whose yaw goes off by `turning` rad/s to the left."""
    turn = np.array([yaw_rotation(turning * t) for t in recording.t])
    n, nan = len(recording), np.full(len(recording), np.nan)
    R = turn @ recording.truth.nav_R_body
    zeros = np.zeros((n, 6))
    return PocketTrack(recording.t, R, zeros[:, :3], zeros, np.arange(0), np.zeros((0, 6, 6)), nan, nan)


@pytest.fixture(scope="module")
def short():
    course = partial(routes._walk_to_and_fro, straight(40.0), 1, rest_s=5.0)
    return simulate(replace(SCENARIOS["pocket-long"], route=course), 3, Choices(sensor="ideal", aligned=True))


def test_minutes_ends_and_jumps_are_read_off_a_run():
    run = run_with([0, 1, 2, 3, 4], z=[0.0, -0.05, -0.08, -0.2, -0.1])
    setting = setting_with(run, passed_min=np.array([2.9, 0.0]))
    assert measures.reached(2, -0.08)(run, setting) == 2.0
    assert measures.reached(2, 0.08)(run, setting) == np.inf
    assert measures.for_good(2, -0.08)(run, setting) == 2.0
    assert measures.for_good(2, -0.05)(run, setting) == 1.0
    assert measures.for_good(2, -0.15)(run, setting) == np.inf
    assert measures.for_good(2, -0.0)(run, setting) == 0.0
    assert measures.at_end(2)(run, setting) == pytest.approx(-0.1)
    assert measures.at_minute(2, 2.5)(run, setting) == pytest.approx(-0.14)
    assert measures.largest(2)(run, setting) == pytest.approx(0.2)
    assert measures.largest(2, 3.5)(run, setting) == pytest.approx(0.1)
    fine = run_with(np.arange(0, 5, 0.1), z=np.where(np.arange(0, 5, 0.1) > 2.95, 0.3, 0.1))
    assert measures.jump(0)(fine, setting) == pytest.approx(0.2)
    assert measures.jump(1)(fine, setting) == pytest.approx(0.0)


def test_yaw_is_read_off_at_the_end_and_between_minutes():
    run = run_with([0, 1, 2, 3], yaw=[0.0, -10.0, 5.0, -20.0])
    setting = setting_with(run, ends=np.array([30.0, 60.0, 120.0]), legs=np.array([0, 1, 2]))
    assert measures.yaw_at_end(run, setting) == 20.0
    assert measures.yaw_range(0, 2)(run, setting) == 15.0
    assert measures.yaw_after(2)(run, setting) == 10.0


def test_a_yaw_that_goes_one_way_does_not_wander_and_strides_do_not_count():
    minute = np.arange(0.0, 15.0, 1 / 60)
    swing = 5.0 * np.sin(2 * np.pi * minute * 60)
    one_way = run_with(minute, yaw=10.0 * minute + swing)
    assert measures.yaw_wander(0, 15)(one_way, setting_with(one_way)) == pytest.approx(1.0)
    back = run_with(minute, yaw=10.0 * np.abs(minute - 7.5) + swing)
    assert measures.yaw_wander(0, 15)(back, setting_with(back)) == pytest.approx(2.0, abs=0.1)
    assert measures.yaw_wander(0, 7.5)(back, setting_with(back)) == pytest.approx(1.0, abs=0.1)


def test_figure_4_has_the_field_of_one_block_and_nothing_inside_iron():
    street = read_setting(simulate("pocket-past-cars", 3, Choices(rate_hz=50.0))).street
    east, north, field = pictures._bent(street, 1.0)
    strength = np.linalg.norm(field, axis=-1)
    middle = np.array([np.median(east), np.median(north)])
    car = np.hypot(east - middle[0], north - middle[1]) < 1.5
    assert np.isnan(strength[car]).all()
    far = np.linalg.norm(street.far.vector)
    np.testing.assert_allclose(np.nanmedian(strength), far, rtol=0.05)
    assert np.nanmax(strength) > 1.2 * far


def test_with_the_true_attitude_the_way_is_nearly_the_true_one(short):
    setting = read_setting(short)
    run = make_run(true_track(short.recording), short.recording, short.recording.truth.nav_R_body, setting)
    assert np.abs(run.yaw_error).max() < 1e-9
    assert measures.away_after(2)(run, setting) < 3.0
    assert np.linalg.norm(run.path - setting.path, axis=1).max() < 4.0
    assert setting.length_m == pytest.approx(80.0, abs=1.0)
    assert set(setting.legs) == {0, 1}


def test_a_yaw_that_goes_off_is_shown_and_turns_the_way(short):
    setting, truth = read_setting(short), short.recording.truth.nav_R_body
    rate = np.radians(180.0) / setting.ends[setting.legs < 1][-1]
    run = make_run(true_track(short.recording, rate), short.recording, truth, setting)
    half = run.minute * 60.0
    np.testing.assert_allclose(run.yaw_error, -np.degrees(rate) * half, atol=1e-6)
    assert measures.yaw_after(1)(run, setting) == pytest.approx(180.0, abs=0.5)


def test_times_and_errors_are_laid_over_each_other():
    run = run_with(np.arange(0.0, 11.0), yaw=np.arange(0.0, 11.0) ** 2)
    setting = setting_with(run)
    assert measures.yaw_grown(0.5, 1.0)(run, setting) == pytest.approx(75.0)
    assert measures.over(measures.yaw_grown(0.5, 1.0), measures.yaw_grown(0.0, 0.5))(run, setting) == pytest.approx(3.0)
    assert measures.ratio(math.inf, 2.0) == math.inf
    assert math.isnan(measures.ratio(math.inf, math.inf))
    assert math.isnan(measures.ratio(1.0, 0.0))


def test_every_row_has_a_case_an_estimator_and_a_name_of_its_own():
    by_name = {case.name: case for case in list_cases(quick=False)}
    names = [name_of(planned.name, reading) for planned in PLAN for reading in planned.readings]
    assert len(names) == len(set(names))
    assert list(TITLES) == [planned.name for planned in PLAN]
    assert set(ALL) == set(ESTIMATORS)
    for planned in PLAN:
        for reading in planned.readings:
            row = reading.row
            assert row.judged in planned.columns
            assert (row.paper is None) or row.printed
            if reading.measure is not None:
                assert row.judged in by_name[reading.case].by
    quick = {case.name for case in list_cases(quick=True)}
    assert quick < set(by_name)
    judged = [r for planned in PLAN for r in planned.readings if r.row.paper is not None and r.case]
    assert {reading.case for reading in judged} <= quick


def values_of(**minutes):
    """One seed: minutes of the filter at the equator and past cars."""
    names = {
        "equator": "D-E2: z is at -0.08 deg/s after, equator",
        "cars": "D-E3: detector: z is at -0.08 deg/s after",
        "ratio": "D-E2: minutes over those at the equator, munich",
    }
    return {names[what]: {"filter": value, "online": 0.5} for what, value in minutes.items()}


def row_of(found, quantity):
    rows = [
        row for planned in PLAN for row in paper.build_experiment(planned, found, 101).rows if row.quantity == quantity
    ]
    return rows[0] if rows else None


def test_medians_and_verdicts_are_those_of_the_seeds():
    found = [values_of(equator=minutes, cars=10.0) for minutes in (12.0, 13.0, math.inf)]
    equator = row_of(found, "z is at -0.08 deg/s after, equator")
    assert equator.ours["filter"].median == 13.0
    assert equator.ours["filter"].high == math.inf
    assert equator.verdict == "put in"
    assert row_of(found, "detector: z is at -0.08 deg/s after").verdict == "missed (explained)"
    assert PUBLISHED.minutes_perturbed == row_of(found, "detector: z is at -0.08 deg/s after").paper


def test_what_no_walk_has_is_left_out():
    found = [values_of(ratio=math.nan), values_of(ratio=2.0)]
    assert row_of(found, "minutes over those at the equator, munich").ours["filter"].n == 1
    assert row_of(found, "z is at -0.08 deg/s after, equator") is None


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A seed with legs of some metres, drawn, and what was shown of it."""
    folder = tmp_path_factory.mktemp("kept")
    shown = []
    with pytest.MonkeyPatch.context() as patch:
        sketch_pictures(patch)
        return folder, paper.reproduce(folder, [7], 1, shown.append, True, SHORT_M), shown


def test_a_short_run_has_every_row_that_is_judged_and_draws_every_figure(kept):
    folder, found, shown = kept
    assert shown == [1.0]
    pictures = [picture.file for experiment in found.experiments for picture in experiment.pictures]
    assert {path.name for path in folder.glob("*.png")} == set(pictures)
    numbers = {int(name.split("-")[1]) for name in pictures}
    assert numbers == {4, 5, 7, 8, 9, 10, 11, 13, 14}
    rows = {(e.name, row.quantity): row for e in found.experiments for row in e.rows}
    # for a minute, from rest: the bias along the thigh is not known to gravity, and the yaw goes off by it
    yaw = rows["D-E4", "yaw error at the end, gravity only"].ours["filter"].median
    assert 3.0 < yaw < 20.0
    assert rows["D-E1", "z off zero at the end, truly 0.1"].verdict == "reproduced"
    # with a field the graph knows it while one walks
    assert rows["D-E2", "z at the end, equator, truly -0.1"].ours["online"].median == pytest.approx(-0.1, abs=0.02)
    assert rows["D-E4", "yaw error at the end, Equator; asked of the graph"].verdict == "as asked"


def test_a_kept_seed_is_taken_up_and_gives_the_same_bytes(kept, monkeypatch):
    folder, found, _ = kept
    monkeypatch.setattr(paper, "walk_seed", lambda *_: pytest.fail("the seed was made again"))
    again = paper.reproduce(folder, [7], 1, lambda _: None, True, SHORT_M)
    assert write_reproduction(again) == write_reproduction(found)


def test_a_kept_seed_holds_no_longer_when_anything_it_was_made_with_differs(kept, monkeypatch, tmp_path):
    folder, _, _ = kept
    wanted = Wanted(True, True, SHORT_M)
    content = json.loads((folder / "cells" / "7.json").read_text())
    assert paper.read_values(7, wanted, folder) is not None
    assert paper.read_values(7, replace(wanted, quick=False), folder) is None
    assert paper.read_values(8, wanted, folder) is None
    (tmp_path / "cells").mkdir()
    place = tmp_path / "cells" / "7.json"
    place.write_text(json.dumps(content))
    assert paper.read_values(7, wanted, tmp_path) is None, "its pictures are not there"
    place.write_text(json.dumps({**content, "pictures": []}))
    assert paper.read_values(7, wanted, tmp_path) is not None
    place.write_text(json.dumps({**content, "pictures": []})[:-20])
    assert paper.read_values(7, wanted, tmp_path) is None
    monkeypatch.setattr(paper, "_code", lambda: "other")
    assert paper.read_values(7, wanted, folder) is None
