"""Our figures beside those of Munoz Diaz et al. (2017): how they are read off a run, kept, and put together."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from fg_nav.frames import compute_heading, yaw_rotation
from fg_nav.lab.reproduce import munoz_diaz2017 as paper
from fg_nav.lab.reproduce.munoz_diaz2017 import make_run, seed_of, walks
from fg_nav.lab.reproduce.munoz_diaz2017.walks import read_setting
from fg_nav.lab.reproduce.results import Line, write_reproduction
from fg_nav.lab.reproduce.runner import run_paper
from fg_nav.lab.simulation import SCENARIOS, Choices, routes, simulate
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.plan import Walk
from fg_nav.pocket import PocketTrack
from tests.lab.reproduce.stored_walks import check_pictures, rows_of, run_with, setting_with
from tests.pictures import sketch_pictures

SHORT_M = 6.0


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


def heading_of(walk):
    return np.unwrap(compute_heading(walk.attitude))


def test_figures_are_read_off_a_run():
    z = run_with([0, 1, 2, 3, 4], z=[0.0, -0.05, -0.08, -0.2, -0.1])
    fine = run_with(np.arange(0, 5, 0.1), z=np.where(np.arange(0, 5, 0.1) > 2.95, 0.3, 0.1))
    yaw = run_with([0, 1, 2, 3], yaw=[0.0, -10.0, 5.0, -20.0])
    growing = run_with(np.arange(0.0, 11.0), yaw=np.arange(0.0, 11.0) ** 2)
    setting = {"passed_min": np.array([2.9, 0.0]), "ends": np.array([30.0, 60.0, 120.0]), "legs": np.array([0, 1, 2])}
    for run, what, given, expected in (
        (z, "reached", (2, -0.08), 2.0),
        (z, "reached", (2, 0.08), math.inf),
        (z, "for_good", (2, -0.08), 2.0),
        (z, "for_good", (2, -0.05), 1.0),
        (z, "for_good", (2, -0.15), math.inf),
        (z, "for_good", (2, -0.0), 0.0),
        (z, "at_end", (2,), -0.1),
        (z, "from_zero", (2,), 0.1),
        (z, "at_minute", (2, 2.5), -0.14),
        (z, "largest", (2,), 0.2),
        (z, "largest", (2, 3.5), 0.1),
        (z, "at_end", (0,), 0.0),
        (z, "share_used", (), 0.0),
        (fine, "jump", (0,), 0.2),
        (fine, "jump", (1,), 0.0),
        (yaw, "yaw_at_end", (), 20.0),
        (yaw, "yaw_range", (0, 2), 15.0),
        (yaw, "yaw_after", (2,), 10.0),
        (growing, "yaw_grown", (0.5, 1.0), 75.0),
        (growing, "yaw_grown_over", (0.5, 1.0, 0.0, 0.5), 3.0),
        (growing, "yaw_range_over", (5, 10, 0, 5), 3.0),
    ):
        found = paper.read_run_figure(what, run, setting_with(run, **setting), *given)
        assert found == pytest.approx(expected), (what, given)
    assert paper.ratio(math.inf, 2.0) == math.inf
    assert math.isnan(paper.ratio(math.inf, math.inf))
    assert math.isnan(paper.ratio(1.0, 0.0))


def test_a_yaw_that_goes_one_way_does_not_wander_and_strides_do_not_count():
    minute = np.arange(0.0, 15.0, 1 / 60)
    swing = 5.0 * np.sin(2 * np.pi * minute * 60)
    one_way, back = (run_with(minute, yaw=10.0 * way + swing) for way in (minute, np.abs(minute - 7.5)))
    for run, end, expected in ((one_way, 15, 1.0), (back, 15, 2.0), (back, 7.5, 1.0)):
        assert paper.read_run_figure("yaw_wander", run, setting_with(run), 0, end) == pytest.approx(expected, abs=0.1)


def test_with_the_true_attitude_the_way_is_nearly_the_true_one(short):
    setting = read_setting(short)
    run = make_run(true_track(short.recording), short.recording, heading_of(short), setting)
    assert np.abs(run.yaw_error).max() < 1e-9
    assert paper.read_run_figure("away_after", run, setting, 2) < 3.0
    assert np.linalg.norm(run.path - setting.path, axis=1).max() < 4.0
    assert setting.length_m == pytest.approx(80.0, abs=1.0)
    assert set(setting.legs) == {0, 1}


def test_a_yaw_that_goes_off_is_shown_and_turns_the_way(short):
    setting = read_setting(short)
    rate = np.radians(180.0) / setting.ends[setting.legs < 1][-1]
    run = make_run(true_track(short.recording, rate), short.recording, heading_of(short), setting)
    half = run.minute * 60.0
    np.testing.assert_allclose(run.yaw_error, -np.degrees(rate) * half, atol=1e-6)
    assert paper.read_run_figure("yaw_after", run, setting, 1) == pytest.approx(180.0, abs=0.5)


def test_a_walk_to_the_north_stands_for_a_field_to_the_east(short):
    for case, nav_field in (("equator", (0, 25, 0)), ("equator, north-south", (25, 0, 0)), ("north-pole", (0, 0, -65))):
        mag = walks.record_first(short, case, 3).mag
        turned = np.einsum("nij,nj->ni", short.recording.truth.nav_R_body, mag)
        np.testing.assert_allclose(turned.mean(axis=0), nav_field, atol=0.01)
        assert turned.std() == pytest.approx(np.hypot(0.015, np.std(nav_field)), rel=0.01)
    assert walks.record_first(short, "gravity", 3).mag is None


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    """A seed with legs of some metres, drawn, and what was shown of it."""
    folder = tmp_path_factory.mktemp("kept")
    shown = []
    with pytest.MonkeyPatch.context() as patch:
        sketch_pictures(patch)
        yield folder, run(folder, patch, shown.append), shown


def run(folder, patch, progress=lambda _: None):
    """Quickly, with legs of some metres and gyroscopes that lie still for minutes."""
    (folder / "pictures").mkdir(exist_ok=True)
    for name in ("FIRST_WALK", "SECOND_WALK"):
        patch.setattr(walks, name, shorten(getattr(walks, name)))
    patch.setattr(paper, "FOG_HOURS", 0.02)
    patch.setattr(paper, "ALLAN_HOURS", 0.3)
    return run_paper("munoz-diaz2017", folder, [7], 1, progress, True)


def shorten(scenario):
    """The first metres of each way out, and the last ones of each way back."""

    def route(rng):
        sections, ways = [], 0
        for section in scenario.route(rng):
            if isinstance(section, Walk):
                begin = section.path.length_m - SHORT_M if ways % 2 else 0.0
                section = replace(section, path=section.path.part(begin, begin + SHORT_M))
                ways += 1
            sections.append(section)
        return sections

    return replace(scenario, route=route)


def test_a_short_run_knows_of_the_biases_what_physics_lets_it_know(kept):
    folder, found, shown = kept
    assert shown == [1.0]
    check_pictures(found, folder, sorted([5, *(8, 9, 10, 11, 13, 14) * 2]))
    rows = rows_of(found)
    # for a minute, from rest: the bias along the thigh is not known to gravity, and the yaw goes off by it
    yaw = rows["D-E4: yaw error at the end, gravity only"].ours["filter"].median
    assert 3.0 < yaw < 20.0
    assert rows["D-E1: z off zero at the end, truly 0.1"].verdict == "reproduced"
    # with a field the graph knows it while one walks
    assert rows["D-E2: z at the end, equator, truly -0.1"].ours["online"].median == pytest.approx(-0.1, abs=0.02)
    assert rows["D-E4: yaw error at the end, Equator; asked of the graph"].verdict == "as asked"
    # what goes in is found again, and a level field is across an upright thigh
    assert rows["D-E0: bias, first walk, y"].ours["ours"].median == pytest.approx(0.1, abs=0.01)
    assert rows["D-E2: field across the thigh, root mean square, equator"].ours["by the field"].median > 20.0
    # what is given the whole walk takes no time, and a quick run has one noise of the magnetometer
    assert "batch" not in rows["D-E2: z is at -0.08 deg/s after, equator"].ours
    assert "D-E5: uncalibrated: z off at most, noise of the magnetometer 0.106 uT" not in rows


def test_a_kept_seed_is_taken_up_and_gives_the_same_bytes(kept, monkeypatch):
    folder, found, _ = kept
    monkeypatch.setattr("fg_nav.lab.store.results.Measurement.run", lambda *_: pytest.fail("the seed was made again"))
    assert write_reproduction(run(folder, monkeypatch)) == write_reproduction(found)


def test_an_estimator_that_ended_is_infinitely_wrong(kept):
    [part] = paper.list_parts([7], True)["seed"]
    seed = seed_of(part.load(kept[0]))
    line = Line("z", measure=("from_zero", "z"), of="munich")
    assert paper.read_line(seed, line)["filter"] < math.inf
    ended = replace(seed, runs={"munich": {**seed.runs["munich"], "filter": None}})
    assert paper.read_line(ended, line)["filter"] == math.inf
