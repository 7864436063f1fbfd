"""The sets side by side: errors as PyShoe counts them, stored paths, and walks on which the filter is better."""

from dataclasses import replace

import numpy as np
import pytest

from fg_nav.detection.stance import Stances
from fg_nav.evaluation import Metrics
from fg_nav.frames import yaw_rotation
from fg_nav.lab.simulation import simulate
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from tests.evaluation.walks import solution
from tests.real_data import DATA, needs_data
from tests.scripts import load_script

beside = load_script("beside")
walks = load_script("walks")

T = np.linspace(0.0, 10.0, 2001)
STRAIGHT = np.column_stack([1.2 * T, np.zeros((len(T), 2))])


def test_pyshoe_counts_from_the_start_with_the_heading_of_the_first_metre():
    found = solution(T, 0.98 * STRAIGHT @ yaw_rotation(0.4).T + [3.0, 2.0, 1.0])
    truth = TrajectoryTruth(T, STRAIGHT)
    # 2 % too short: the error grows from 0 to 24 cm, 12 on the mean, over the root of two
    assert beside.measure_as_pyshoe(found, truth) == pytest.approx(0.12 / np.sqrt(2), rel=1e-3)


def test_pyshoe_does_not_forgive_what_a_best_fit_does():
    bent = STRAIGHT + np.column_stack([np.zeros(len(T)), np.where(T < 1.0, 0.1 * T, 0.1), np.zeros(len(T))])
    found = solution(T, bent)
    truth = TrajectoryTruth(T, STRAIGHT)
    wrong_heading = np.arctan2(0.1, 1.2)
    expected = np.mean(np.hypot(*(bent @ yaw_rotation(-wrong_heading).T - STRAIGHT)[:, :2].T)) / np.sqrt(2)
    assert beside.measure_as_pyshoe(found, truth) == pytest.approx(expected, rel=0.01)


def test_a_stored_path_is_laid_on_the_footprints_at_their_times():
    recording = simulate("demo", 3).recording
    when = recording.t[400:-400:300]
    path = np.column_stack([recording.t, np.sin(recording.t)])
    xy = np.column_stack([when, np.sin(when)]) @ yaw_rotation(2.0)[:2, :2].T + [1.0, 5.0]
    truth = FootprintTruth(np.arange(len(when)), xy, len(when) - 1, when)
    none = Stances.from_mask(np.zeros(len(recording), dtype=bool))
    walk = walks.Walk("made up", replace(recording, truth=truth), none, track=path)
    [stored] = beside.measure_stored("s", walk)
    assert (stored.method, stored.value("points")) == ("stored", len(when))
    assert stored.value("rmse_2d_m") < 1e-9
    late = replace(walk, track=path + np.where(recording.t > when[-4], 1.0, 0.0)[:, None])
    assert beside.measure_stored("s", late)[0].value("max_error_m") > 0.5
    assert beside.measure_stored("s", replace(walk, track=None)) == []


@pytest.mark.parametrize(
    ("smoother", "iez", "worse"),
    [(0.10, 0.06, True), (0.08, 0.06, False), (2.3, 1.0, True), (1.05, 1.0, False), (np.inf, 1.0, True)],
)
def test_worse_by_a_tenth_and_three_centimetres(smoother, iez, worse):
    assert beside.is_worse(smoother, iez) is worse


def test_sets_are_printed_and_judged(capsys):
    blank = Metrics(distance_m=100.0, closure_m=0.0, strides_detected=80)
    errors = {"a 1": (0.10, 0.06), "a 2": (0.2, 0.5), "b 1": (0.3, 0.3)}
    rows = [
        beside.Result("s", walk, method, replace(blank, rmse_2d_m=error))
        for walk, both in errors.items()
        for method, error in zip(("smoother", "iez"), both, strict=True)
    ]
    rows.append(beside.Result("s", "a 2", "stored", beside.Track(0.7, 1.0, 1.0, 9, 9)))
    found = {f.name: f for f in beside.judge_sets(rows, {"A": (("s",), "a"), "B": (("s",), "b"), "C": (("t",), "")})}
    assert found["A: smoother over iez, mean"].measured == pytest.approx(0.30 / 0.56)
    assert found["A: worse than iez by 10 % and 3 cm, walks of 2"].measured == 1
    assert found["B: worse than iez by 10 % and 3 cm, walks of 1"].measured == 0
    assert found["all sets: worse than iez by 10 % and 3 cm, of 3 walks"].measured == 1
    out = capsys.readouterr().out
    assert "A, a 1: smoother 0.100 m, iez 0.060 m" in out
    assert out.count("stored") == 1
    assert "C" not in {name.split(":")[0] for name in found}


def test_the_end_is_measured_over_its_sigmas():
    found = solution(T, STRAIGHT)
    count = len(found.stances)
    covariance = np.tile(np.diag([4.0, 9.0, 0.25]), (count, 1, 1))
    place = np.outer(np.arange(count) / (count - 1), [2.0, -3.0, 1.0])
    table = replace(found.stances, position=place, position_cov=covariance)
    end = beside.measure_end(replace(found, stances=table))
    assert end == pytest.approx(
        {"ground_m": 13**0.5, "z_m": 1.0, "end_sigma_m": 13**0.5, "ground_ratio": 1.0, "z_ratio": 2.0}
    )


def test_an_end_that_is_off_is_unseen_unless_the_verdict_names_it():
    off = replace(Metrics(distance_m=100.0, closure_m=0.0, strides_detected=80), end_error_m=3.1)
    row = beside.Result("s", "w", "iez", off, end={"end_sigma_m": 1.0}, verdict="doubtful")
    assert row.is_off_unseen
    assert not replace(row, verdict="not to be used").is_off_unseen
    assert not replace(row, end={"end_sigma_m": 1.1}).is_off_unseen
    assert not replace(row, method="stored").is_off_unseen
    assert not replace(row, metrics=None, failure="there is no solution").is_off_unseen


@needs_data
def test_what_the_authors_stored_is_read_with_the_walks():
    [surveyed] = walks.read_gdlbio(DATA, [48])
    assert len(surveyed.track) == len(surveyed.recording)
    [stored] = beside.measure_stored("s", surveyed)
    assert 0.02 < stored.value("rmse_2d_m") < 0.2  # a hundred times worse if it were left-handed
