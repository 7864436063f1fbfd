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
    folder = tmp_path_factory.mktemp("pocket")
    recording = walk.recording.slice(0, len(walk.recording) // 2)
    write_canonical(recording, folder / "pocket.csv")
    write_canonical(replace(recording, mag=None), folder / "bare.csv")
    write_canonical(replace(recording, mag=np.full_like(recording.mag, np.nan)), folder / "empty.csv")
    write_canonical(recording.slice(0, 500), folder / "standing.csv")
    write_canonical(simulate("demo", 103).recording.slice(0, 5000), folder / "foot.csv")
    return folder


def way(walk):
    """Metres that the foot below has gone."""
    return float(np.linalg.norm(np.diff(walk.strides.footprint[:, :2], axis=0), axis=1).sum())


@pytest.mark.parametrize("method", METHODS)
def test_it_finds_the_way_with_a_known_distance(walk, method):
    solution = navigate_pocket(walk.recording, method, known_distance_m=way(walk))
    assert solution.method == method
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
    ways = []
    for turn in (np.eye(3), np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])):
        r = walk.recording
        turned = replace(r, acc=r.acc @ turn.T, gyr=r.gyr @ turn.T, mag=r.mag @ turn.T, truth=None)
        ways.append(navigate_pocket(turned, heading=2.0, step_constant_m=0.78).position)
    np.testing.assert_allclose(ways[0], ways[1], atol=0.3)
    first = ways[0][np.searchsorted(np.linalg.norm(ways[0], axis=1), 4.0)]
    assert np.arctan2(first[0], first[1]) == pytest.approx(2.0, abs=0.1)


def test_what_speaks_against_a_recording_is_said():
    r = replace(simulate("demo", 103, Choices(worn="pocket", aligned=True)).recording, mag=None, truth=None)
    plain = navigate_pocket(r, PAPER, step_constant_m=0.78).notes
    assert not [note for note in plain if "turned in the pocket" in note or "clipped" in note or "was it in" in note]
    about_the_bone = yaw_rotation(np.radians(40.0))
    later = (np.arange(len(r)) > len(r) // 2)[:, None]
    acc, gyr = (np.where(later, x @ about_the_bone.T, x) for x in (r.acc, r.gyr))
    slipped = navigate_pocket(replace(r, acc=acc, gyr=gyr), PAPER, step_constant_m=0.78).notes
    assert any("turned in the pocket" in note for note in slipped)
    clipped = navigate_pocket(replace(r, gyr=np.clip(r.gyr, -2.5, 2.5)), PAPER, step_constant_m=0.78).notes
    assert any("clipped" in note for note in clipped)


def test_standing_and_turning_on_the_spot_go_nowhere():
    out, about = Walk(straight(15.0)), TurnOnSpot(np.pi)
    course = [Stand(4.0), out, about, Stand(6.0), Walk(straight(15.0).reverse()), Stand(3.0)]
    own = replace(scenario("demo"), name="to and fro", route=lambda rng: course)
    made = simulate(own, 104, Choices(worn="pocket"))
    solution = navigate_pocket(made.recording, PAPER, step_constant_m=0.78)
    assert any("in 2 stretches;" in note for note in solution.notes)
    end = solution.position[-1] - solution.position[0]
    assert np.linalg.norm(end) < 2.5
    truth = made.recording.truth.position
    quiet = np.flatnonzero(np.linalg.norm(np.gradient(truth[:, :2], solution.t, axis=0), axis=1) < 0.01)
    inner = quiet[(quiet > 100) & (quiet < len(truth) - 100)]
    assert np.median(np.linalg.norm(solution.velocity[inner], axis=1)) == 0.0


def test_the_files_are_those_of_a_foot(fg_nav, files):
    options = ("--mount", "pocket", "--method", PAPER, "--known-distance", 36)
    ran = fg_nav("run", files / "pocket.csv", *options, "--out", "o")
    assert ran.code == 0, ran.err
    names = {path.name for path in Path("o").iterdir()}
    assert {"trajectory.tum", "strides.csv", "summary.json", "config.json", "report.html"} <= names
    strides = pd.read_csv("o/strides.csv")
    summary, config = (json.loads(Path(f"o/{name}.json").read_text()) for name in ("summary", "config"))
    assert (summary["method"], summary["magnetometer"]) == (PAPER, "used")
    assert summary["strides"] == len(strides) - 1
    assert 33 < summary["distance_m"] < 36.5  # along the rows, which cut the corners
    assert strides["sigma_x_m"].iloc[0] == 0.0 < strides["sigma_x_m"].iloc[-1]
    assert set(strides["field"]) <= {"quasi-static", "disturbed", "none"}
    assert config["parameters"]["step_length"]["source"] == "known distance"
    assert len(np.loadtxt("o/trajectory.tum")) == config["samples"]


def test_without_a_magnetometer_it_says_so_and_goes_on(fg_nav, files):
    for name, *options in (["bare.csv"], ["empty.csv"], ["pocket.csv", "--no-mag"]):
        ran = fg_nav("run", files / name, *options, "--mount", "pocket", "--method", PAPER, "--out", "o", "--force")
        assert ran.code == 0, ran.err
        notes = json.loads(Path("o/summary.json").read_text())["notes"]
        assert any("the heading at the start is unknown" in note for note in notes)
        assert set(pd.read_csv("o/strides.csv", keep_default_na=False)["field"]) == {"none"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("foot.csv --mount pocket", ["on a foot", "leave --mount pocket out"]),
        ("pocket.csv", ["in a trouser pocket", "--mount pocket"]),
        ("standing.csv --mount pocket", ["no walk in it"]),
        ("pocket.csv --mount pocket --method iez", ["iez is for --mount foot", "pocket"]),
        ("pocket.csv --method pocket", ["pocket is for --mount pocket"]),
        ("pocket.csv --mount pocket --method best", ["no method 'best'", PAPER]),
        ("foot.csv --known-distance 10", ["is for --mount pocket: add that"]),
        ("pocket.csv --mount pocket --known-distance nan", ["known distance", "metres walked"]),
        ("pocket.csv --mount pocket --step-constant 7", ["no person's"]),
        ("pocket.csv --mount pocket --step-constant 0.8 --known-distance 70", ["give one of them"]),
        ("pocket.csv --mount pocket --gate ma2018", ["--gate is for --mount foot"]),
        ("pocket.csv --mount pocket --preset physical", ["--preset is for --mount foot"]),
        ("pocket.csv --mount pocket --set iez.acc_density=1", ["--set is for --mount foot"]),
        ("pocket.csv --mount pocket --heading nan", ["no direction"]),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(fg_nav, files, arguments, words):
    name, *options = arguments.split()
    if "pocket" in options and "--method" not in options:
        options += ["--method", PAPER]
    ran = fg_nav("run", files / name, *options, "--out", "o")
    assert ran.refused(*words), ran.err
    assert not Path("o").exists()


def test_a_pocket_of_few_strides_is_never_trusted_and_none_is_told_of_a_foots_rate(walk):
    whole = navigate(replace(walk.recording, truth=None), "pocket", options=Options(mount="pocket"))
    assert whole.verdict.word == "trusted"
    begin = int(whole.stances.sample[0])
    few = walk.recording.slice(max(begin - 100, 0), int(whole.stances.sample[2]))
    found = navigate(replace(few, truth=None), "pocket", options=Options(mount="pocket"))
    assert len(found.stances) - 1 <= 2
    assert found.verdict.word == "not to be used"
    slow = Recording(*(x[::3] for x in (walk.recording.t, walk.recording.acc, walk.recording.gyr)))  # 33 Hz
    reasons = navigate(slow, "pocket", options=Options(mount="pocket")).verdict.reasons
    assert not any("foot" in words for words in reasons)
