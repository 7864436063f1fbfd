"""`fg-nav run --mount pocket`: files, figures, and words for what cannot be."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from fg_nav.evaluation import evaluate
from fg_nav.frames import yaw_rotation
from fg_nav.io import write_canonical
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.lab.simulation.path import straight
from fg_nav.lab.simulation.plan import Stand, TurnOnSpot, Walk
from fg_nav.lab.simulation.scenarios import scenario
from fg_nav.pipeline import navigate
from fg_nav.pocket.navigate import METHODS, navigate_pocket
from fg_nav.recording import Recording
from fg_nav.walk import Options

PAPER = METHODS[1]


@pytest.fixture(scope="module")
def walk():
    """Seventy metres of corridors, in the pocket."""
    return simulate("demo", 103, Choices(worn="pocket"))


@pytest.fixture(scope="module")
def files(walk, tmp_path_factory):
    folder, recording = tmp_path_factory.mktemp("pocket"), walk.recording.slice(0, len(walk.recording) // 2)
    for name, one in {
        "pocket": recording,
        "bare": replace(recording, mag=None),
        "empty": replace(recording, mag=np.full_like(recording.mag, np.nan)),
        "standing": recording.slice(0, 500),
        "foot": simulate("demo", 103).recording.slice(0, 5000),
    }.items():
        write_canonical(one, folder / f"{name}.csv")
    return folder


@pytest.mark.parametrize("method", METHODS)
def test_it_finds_the_way_with_a_known_distance(walk, method):
    way = float(np.linalg.norm(np.diff(walk.strides.footprint[:, :2], axis=0), axis=1).sum())  # of the foot below
    solution = navigate_pocket(walk.recording, method, known_distance_m=way)
    assert (solution.method, solution.parameters["step_length"]["source"]) == (method, "known distance")
    assert set(solution.stances.field) <= {"quasi-static", "disturbed", "none"}
    assert len(solution.t) == len(solution.position) == len(solution.velocity) == len(walk.recording)
    assert abs(len(solution.stances) - 1 - len(walk.strides)) <= 1
    metrics = evaluate(solution, walk.recording.truth)
    assert metrics.rmse_2d_m < 1.5
    assert metrics.scale == pytest.approx(1.0, abs=0.06)
    assert metrics.heading_rmse_deg < 6.0
    assert (np.linalg.eigvalsh(solution.stances.position_cov) >= -1e-9).all()
    moved = np.cumsum((solution.velocity[1:] + solution.velocity[:-1]) / 2 * np.diff(solution.t)[:, None], axis=0)
    np.testing.assert_allclose(solution.position[1:], solution.position[0] + moved, atol=0.3)
    np.testing.assert_allclose(solution.position[-1], solution.position[0] + moved[-1], atol=0.05)


def test_a_heading_is_that_of_the_first_strides_however_the_sensor_lies(walk):
    """A quarter turn of the sensor about any axis leaves the way as it is."""
    ways, r = [], walk.recording
    for turn in (np.eye(3), np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])):
        turned = replace(r, acc=r.acc @ turn.T, gyr=r.gyr @ turn.T, mag=r.mag @ turn.T, truth=None)
        ways.append(navigate_pocket(turned, heading=2.0, step_constant_m=0.78).position)
    np.testing.assert_allclose(ways[0], ways[1], atol=0.3)
    first = ways[0][np.searchsorted(np.linalg.norm(ways[0], axis=1), 4.0)]
    assert np.arctan2(first[0], first[1]) == pytest.approx(2.0, abs=0.1)


def test_what_speaks_against_a_recording_is_said():
    r = replace(simulate("demo", 103, Choices(worn="pocket", aligned=True)).recording, mag=None, truth=None)
    later = (np.arange(len(r)) > len(r) // 2)[:, None]
    about_the_bone = yaw_rotation(np.radians(40.0)).T
    acc, gyr = (np.where(later, x @ about_the_bone, x) for x in (r.acc, r.gyr))
    for changed, said in (
        ({}, []),
        ({"acc": acc, "gyr": gyr}, ["turned in the pocket"]),
        ({"gyr": np.clip(r.gyr, -2.5, 2.5)}, ["clipped"]),
    ):
        notes = " ".join(navigate_pocket(replace(r, **changed), PAPER, step_constant_m=0.78).notes)
        assert all(words in notes for words in said)
        assert said or not any(words in notes for words in ("turned in the pocket", "clipped", "was it in"))


def test_standing_and_turning_on_the_spot_go_nowhere():
    out = straight(15.0)
    course = [Stand(4.0), Walk(out), TurnOnSpot(np.pi), Stand(6.0), Walk(out.reverse()), Stand(3.0)]
    own = replace(scenario("demo"), name="to and fro", route=lambda rng: course)
    made = simulate(own, 104, Choices(worn="pocket"))
    solution = navigate_pocket(made.recording, PAPER, step_constant_m=0.78)
    assert any("in 2 stretches;" in note for note in solution.notes)
    assert np.linalg.norm(solution.position[-1] - solution.position[0]) < 2.5
    speed = np.linalg.norm(np.gradient(made.recording.truth.position[:, :2], solution.t, axis=0), axis=1)
    quiet = np.flatnonzero(speed[100:-100] < 0.01) + 100
    assert np.median(np.linalg.norm(solution.velocity[quiet], axis=1)) == 0.0


def test_without_a_magnetometer_it_says_so_and_goes_on(fg_nav, files):
    for name, *options in (["bare.csv"], ["empty.csv"], ["pocket.csv", "--no-mag"]):
        ran = fg_nav("run", files / name, *options, "--mount", "pocket", "--method", PAPER, "--out", "o", "--force")
        assert ran.code == 0, ran.err
        notes = json.loads(Path("o/summary.json").read_text())["notes"]
        assert any("the heading at the start is unknown" in note for note in notes)
        assert set(pd.read_csv("o/strides.csv", keep_default_na=False)["field"]) == {"none"}


REFUSED = {
    "foot.csv --mount pocket": ["on a foot", "leave --mount pocket out"],
    "pocket.csv": ["in a trouser pocket", "run RECORDING --mount pocket"],
    "standing.csv --mount pocket": ["no walk in it"],
    "pocket.csv --mount pocket --method iez": ["iez is for --mount foot", "pocket"],
    "pocket.csv --method pocket": ["pocket is for --mount pocket"],
    "pocket.csv --mount pocket --known-distance nan": ["known distance", "metres walked"],
    "pocket.csv --mount pocket --step-constant 0.8 --known-distance 70": ["give one of them"],
}


@pytest.mark.parametrize("arguments", REFUSED)
def test_what_cannot_be_is_refused_in_one_line(fg_nav, files, arguments):
    name, *options = arguments.split()
    if "pocket" in options and "--method" not in options:
        options += ["--method", PAPER]
    ran = fg_nav("run", files / name, *options, "--out", "o")
    assert ran.refused(*REFUSED[arguments]), ran.err
    assert not Path("o").exists()


def test_a_pocket_of_few_strides_is_never_trusted_and_none_is_told_of_a_foots_rate(walk):
    def judged(recording):
        found = navigate(replace(recording, truth=None), "pocket", options=Options(mount="pocket"))
        return found.stances, found.verdict

    stances, verdict = judged(walk.recording)
    assert verdict.word == "trusted"
    short = navigate(walk.recording, "pocket", options=Options(mount="pocket", step_constant_m=0.5)).verdict
    assert short.word != "trusted"
    assert any("4.4 sigma from an adult's" in words for words in short.reasons)
    few, verdict = judged(walk.recording.slice(max(int(stances.sample[0]) - 100, 0), int(stances.sample[2])))
    assert len(few) - 1 <= 2
    assert verdict.word == "not to be used"
    r = walk.recording
    _, verdict = judged(Recording(r.t[::3], r.acc[::3], r.gyr[::3]))  # 33 Hz
    assert not any("foot" in words for words in verdict.reasons)
