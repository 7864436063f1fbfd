"""Gait parameters: physics of simulated feet, motion capture, gaitmap, and the force under the foot."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from fg_nav import Options, navigate, run_iez, smooth
from fg_nav.detection import detect_stances
from fg_nav.errors import EstimationError
from fg_nav.gait import GAIT_COLUMNS, MAX_TURN_DEG, PARAMETERS, summarize_gait, tabulate_gait
from fg_nav.lab.simulation import simulate_feet
from fg_nav.lab.simulation.foot import HEEL_STRIKE_AT, LANDED_AT, TOE_DOWN_AT
from fg_nav.lab.simulation.motion import Style
from fg_nav.solution import Solution
from fg_nav.truth import TrajectoryTruth
from tests.real_data import DATA, needs_data
from tests.report.walks import stance_table
from tests.scripts import load_script
from tests.simulated import FIRM, PERSON, RIGID, SimulatedFoot, corridor, straight_walk

FOLDER = DATA or Path()


def true_solution(walk: SimulatedFoot) -> Solution:
    """The walk as it was, with footfalls in the middle of what is flat."""
    t, flat = walk.recording.t, walk.motion.flat
    state, sample = walk.motion.at(t), np.searchsorted(t, flat.mean(axis=1)).clip(max=len(t) - 1)
    return of_path(t, state.position, state.velocity, state.nav_R_body, sample)


def of_path(t, position, velocity, attitude, sample) -> Solution:
    nothing = np.zeros((len(sample), 3))
    unknown = {"gyro_bias": nothing, "gyro_bias_sigma": nothing, "heading_sigma": nothing[:, 0]}
    cov = np.zeros((len(sample), 3, 3))
    table = stance_table(t, position, attitude, sample, position_cov=cov, **unknown)
    return Solution("truth", t, position, velocity, attitude, table, runtime_s=0.0)


@pytest.fixture(scope="module")
def walk() -> SimulatedFoot:
    """A minute round a corridor, of a foot that is hit and slips."""
    return corridor(PERSON)


@pytest.fixture(scope="module")
def true(walk: SimulatedFoot) -> pd.DataFrame:
    return tabulate_gait({"": true_solution(walk)})


def test_strides_are_those_that_were_walked(walk: SimulatedFoot, true: pd.DataFrame) -> None:
    """Of a straight walk at a steady pace: length, duration, lift, and neither turn nor rise."""
    straight = straight_walk(RIGID, strides=14, mount=FIRM)
    table = true_solution(straight).to_dataframe("strides")
    steady, k = table[table["steady"]], table["index"][table["steady"]].to_numpy()
    assert len(steady) > 8
    footprint = straight.strides.footprint
    np.testing.assert_allclose(steady["length_m"], np.hypot(*np.diff(footprint[:, :2], axis=0).T)[k], atol=0.005)
    np.testing.assert_allclose(steady["duration_s"].mean(), straight.strides.duration[k].mean(), rtol=0.01)
    np.testing.assert_allclose(steady["speed_m_s"], steady["length_m"] / steady["duration_s"])
    np.testing.assert_allclose(steady["cadence_steps_min"] * steady["duration_s"], 120.0)
    assert np.abs(steady["turning_deg"]).max() < 5.0
    assert np.abs(steady["rise_m"]).max() < 0.005
    height, at = straight.motion.at(straight.recording.t).position[:, 2], straight.recording.t
    inside = [(at >= begin) & (at <= end) for begin, end in zip(steady["start_s"], steady["end_s"], strict=True)]
    lifted = [height[part].max() - height[part][0] for part in inside]
    np.testing.assert_allclose(steady["clearance_m"], lifted, atol=0.005)
    # Round the corners the foot turns as the strides do, clockwise as headings are.
    turned = np.degrees(np.diff(walk.strides.heading))[true["index"]]
    assert np.abs(turned).max() > 20.0
    np.testing.assert_allclose(true["turning_deg"], turned, atol=5.0)
    assert not true["steady"][np.abs(true["turning_deg"]) > MAX_TURN_DEG].any()


def test_clearance_of_a_stair_is_that_over_the_line_between_its_footfalls() -> None:
    t = np.linspace(0.0, 1.2, 241)
    share = 0.5 * (1.0 - np.cos(np.pi * t / t[-1]))
    way = np.column_stack([0.3 * share, 0.4 * share, 0.34 * share + 0.12 * np.sin(np.pi * share)])
    stair = of_path(t, way, np.gradient(way, t, axis=0), np.tile(np.eye(3), (len(t), 1, 1)), np.array([0, 240]))
    (row,) = stair.to_dataframe("strides").itertuples()
    assert (row.length_m, row.rise_m, row.clearance_m) == pytest.approx((0.5, 0.34, 0.12), abs=1e-9)
    assert row.duration_s == pytest.approx(1.2)  # a foot that does not turn has no contact
    assert np.isnan([row.contact_s, row.toe_off_s, row.stance_share]).all()
    assert not row.steady


def test_contact_and_toe_off_are_at_the_turning_points_of_the_pitch(walk: SimulatedFoot, true: pd.DataFrame) -> None:
    start, k = walk.strides.start, true["index"].to_numpy()
    swing_s = (walk.motion.flat[1:, 0] - start) / LANDED_AT
    known = true["contact_s"].notna().to_numpy() & (walk.strides.style[k] == Style.WALK)
    assert known.mean() > 0.8
    contact = (start + HEEL_STRIKE_AT * swing_s)[k]
    np.testing.assert_allclose(true["contact_s"][known], contact[known], atol=0.04)
    # The toe leaves while the foot turns down fastest, before it points down most.
    share = ((true["toe_off_s"] - start[k]) / swing_s[k])[known]
    assert share.between(0.1, TOE_DOWN_AT).all()
    assert true["stance_share"][true["steady"]].between(0.45, 0.65).all()


def test_neither_mounting_nor_heading_nor_place_changes_anything(walk: SimulatedFoot, true: pd.DataFrame) -> None:
    solution, state = true_solution(walk), walk.motion.at(walk.recording.t)
    turn = Rotation.from_euler("z", 130.0, degrees=True).as_matrix()
    for mount in Rotation.random(3, rng=4).as_matrix():
        moved = of_path(
            solution.t, state.position @ turn.T + [3.0, -2.0, 1.0], state.velocity @ turn.T,
            turn @ state.nav_R_body @ mount, solution.stances.sample,
        )  # fmt: skip
        pd.testing.assert_frame_equal(tabulate_gait({"": moved}), true, atol=1e-6)


def test_halts_and_holes_are_no_strides(walk: SimulatedFoot, true: pd.DataFrame) -> None:
    solution = true_solution(walk)
    t, sample = solution.t, solution.stances.sample
    # seven tenths of a second in which nothing was recorded
    at = int(sample[20]) + 60
    later = np.where(np.arange(len(t)) < at, t, t + 0.7)
    holed = replace(solution, t=later, stances=replace(solution.stances, t=later[sample]))
    table = tabulate_gait({"": holed})
    assert set(true["index"]) - set(table["index"]) == {20}
    assert not table["steady"][table["index"].isin([19, 21])].any()
    # a halt of five seconds, at whose beginning or end the foot stood stillest
    at = int(sample[20])
    row = np.concatenate([np.arange(at), np.full(1000, at), np.arange(at, len(t))])
    for stillest in (at, at + 1000):
        moved = np.concatenate([sample[:20], [stillest], sample[21:] + 1000])
        path = solution.position[row], solution.velocity[row], solution.nav_R_body[row]
        table = tabulate_gait({"": of_path(np.arange(len(row)) * (t[1] - t[0]), *path, moved)})
        assert 20 in set(true["index"]) - set(table["index"]) <= {19, 20}
        assert table["duration_s"].max() < 2.5
        assert table["contact_s"].notna().sum() >= true["contact_s"].notna().sum() - 2
        assert table.set_index("index").loc[[18, 21], "stance_share"].notna().all()
    # who sets off and stops is not steady
    strides = tabulate_gait({"": true_solution(straight_walk(strides=10, standing_s=5.0))})
    assert not strides["steady"].iloc[[0, -1]].any()


def test_sigmas_are_true_and_those_of_the_joint_covariance() -> None:
    """Of feet that move on in stance as real ones do, which makes the strides of a whole walk too short alike."""
    ratios, turns = [], []
    for seed in range(3):
        foot = corridor(PERSON.with_moving_feet(np.random.default_rng(seed)), seed=seed)
        recording, stances = foot.recording, detect_stances(foot.recording)
        solution, truth = smooth(recording, stances), true_solution(foot)
        sample = solution.stances.sample
        path = of_path(truth.t, truth.position, truth.velocity, truth.nav_R_body, sample)
        table, known = (one.to_dataframe("strides").set_index("index") for one in (solution, path))
        for of, name in ((ratios, "length_m"), (turns, "turning_deg")):
            of.append(((table[name] - known[name]) / table[f"sigma_{name}"]).dropna())
        np.testing.assert_allclose(table["sigma_speed_m_s"] * table["duration_s"], table["sigma_length_m"])
    assert 0.4 < np.sqrt(np.mean(np.concatenate(ratios) ** 2)) < 1.3
    assert np.sqrt(np.mean(np.concatenate(turns) ** 2)) < 1.3
    assert table["sigma_length_m"].median() < 0.05
    # a nominal rate is an error that all strides share; a filter has no joint covariance
    wide = solution.widen(0.01).to_dataframe("strides")
    expected = np.hypot(table["sigma_length_m"], 0.02 * table["length_m"])
    np.testing.assert_allclose(wide["sigma_length_m"], expected, rtol=0.02)
    assert run_iez(recording, stances).to_dataframe("strides")["sigma_length_m"].isna().all()


@pytest.fixture(scope="module")
def feet() -> dict[str, Solution]:
    """Both feet of one walk as they were."""
    found = {}
    for side, one in simulate_feet("demo", 5).sides.items():
        truth, stances = one.recording.truth, detect_stances(one.recording)
        assert isinstance(truth, TrajectoryTruth)
        velocity = np.gradient(truth.position, truth.t, axis=0)
        sample = stances.stillest(one.recording.gyr)
        found[side] = of_path(truth.t, truth.position, velocity, truth.nav_R_body, sample)
    return found


def test_steps_of_both_feet_make_up_the_strides(feet: dict[str, Solution]) -> None:
    table = tabulate_gait(feet, beside=True)
    assert tuple(table.columns) == GAIT_COLUMNS
    straight = table[table["steady"] & (table["turning_deg"].abs() < 10.0)]
    assert len(straight) > 30
    walked = simulate_feet("demo", 5).step_width_m
    assert straight["step_width_m"].mean() == pytest.approx(walked, abs=0.05)
    assert straight.groupby("foot")["step_width_m"].mean().min() > 0.0
    for foot, other in (("left", "right"), ("right", "left")):
        # the step of the other foot that ends within a stride, and that of this one: together the stride
        for row in straight[straight["foot"] == foot].itertuples():
            between = table[(table["foot"] == other) & table["end_s"].between(row.start_s, row.end_s)]
            if len(between) == 1 and abs(between["turning_deg"].iloc[0]) < 10.0:
                length = row.step_length_m + between["step_length_m"].iloc[0]
                assert length == pytest.approx(row.length_m, abs=0.05)
                assert row.step_time_s + between["step_time_s"].iloc[0] == pytest.approx(row.duration_s, abs=1e-6)
    apart = tabulate_gait(feet)
    assert apart[["step_length_m", "step_width_m", "step_time_s"]].isna().all(axis=None)
    pd.testing.assert_series_equal(apart["length_m"], table["length_m"])


def test_a_summary_has_means_of_steady_strides_and_how_the_feet_differ(feet: dict[str, Solution]) -> None:
    table = tabulate_gait(feet, beside=True)
    found = summarize_gait(table)
    of_left = table[(table["foot"] == "left") & table["steady"]]
    assert found["left"]["strides"] == len(of_left)
    assert found["left"]["mean"] == of_left[list(PARAMETERS)].mean().to_dict()
    assert found["left"]["sd"]["length_m"] == of_left["length_m"].std()
    limping = table.assign(step_time_s=np.where(table["foot"] == "left", 0.5, 0.6))
    assert summarize_gait(limping)["asymmetry_percent"]["step_time_s"] == pytest.approx(100 * 0.1 / 0.55)
    assert summarize_gait(table[table["foot"] == "left"].iloc[:3]) == {"left": {"strides": 2}}
    assert summarize_gait(table.iloc[:0]) == {"": {"strides": 0}}


def test_a_sensor_in_a_pocket_and_unknown_rows_are_refused(walk: SimulatedFoot) -> None:
    result = navigate(walk.recording, "iez", options=Options(mount="foot"))
    with pytest.raises(EstimationError, match="no rows 'steps': choose one of samples, footfalls, strides"):
        result.to_dataframe("steps")  # type: ignore[arg-type]
    leg = replace(result, walk=replace(result.walk, options=Options(mount="pocket")))
    with pytest.raises(EstimationError, match="sensor on a foot: take the rows"):
        leg.to_dataframe("strides")


# --- as they were recorded -------------------------------------------------------------------------------------------

references = load_script("experiments.gait")
SAMPLE = FOLDER / "two_feet" / "gaitmap"


@needs_data
def test_lengths_and_clearance_are_those_of_motion_capture() -> None:
    """Of three walks, round a small room: half of the strides to a centimetre or two."""
    trials = sorted((FOLDER / "vicon").glob("2017-11-22*"))[:3]
    found = references.measure_trials(trials)
    assert found["length_m"]["strides"] > 60
    assert found["length_m"]["typical"] < 0.02
    assert abs(found["length_m"]["bias"]) < 0.02
    assert found["clearance_m"]["typical"] < 0.01


@needs_data
def test_both_feet_are_as_motion_capture_has_them() -> None:
    found = references.measure_markers(FOLDER / "feet_vicon")
    assert found["length_m"]["typical"] < 0.01
    assert found["clearance_m"]["typical"] < 0.01
    assert found["turning_deg"]["typical"] < 2.0
    # Between the feet nothing measures: their steps tie them to 0.05 m.
    assert abs(found["step_length_m"]["bias"]) < 0.02
    assert abs(found["step_width_m"]["bias"]) < 0.05
    assert max(found[name]["typical"] for name in ("step_length_m", "step_width_m")) < 0.06


@needs_data
def test_markers_of_gaitmaps_sample() -> None:
    """A sensor by which gaitmap, too, is off by 0.05 m a stride; no bias."""
    found = references.measure_markers(SAMPLE)
    assert abs(found["length_m"]["bias"]) < 0.015
    assert found["length_m"]["sd"] < 0.06
    assert found["clearance_m"]["typical"] < 0.01
    assert abs(found["turning_deg"]["bias"]) < 0.5
    assert found["turning_deg"]["typical"] < 1.5


@needs_data
def test_gaitmap_on_the_same_strides() -> None:
    python = os.environ.get("FG_NAV_GAITMAP")
    if python is None:
        pytest.skip("gaitmap needs pandas 2, so an interpreter of its own: name one that has it in FG_NAV_GAITMAP")
    found = references.measure_gaitmap(SAMPLE, python)
    assert found["length_m"]["strides"] > 50
    assert found["length_m"]["typical"] < 0.02
    assert found["clearance_m"]["typical"] < 0.01
    assert found["turning_deg"]["typical"] < 0.2


def differ(at: pd.Series, events: np.ndarray) -> np.ndarray:
    """From the nearest event within 0.2 s to `at`, s."""
    nearest = events[np.abs(at.to_numpy()[:, None] - events).argmin(axis=1)]
    return (at - nearest)[np.abs(at - nearest) < 0.2].to_numpy()


@needs_data
def test_contacts_are_those_of_gaitmaps_example() -> None:
    strides = references.navigate_pair(SAMPLE).to_dataframe("strides")
    for side, own in pd.read_csv(SAMPLE / "stride_events_sample.csv").groupby("foot"):
        of_side = strides[(strides["foot"] == side) & strides["steady"]]
        for name, event in (("contact_s", "ic"), ("toe_off_s", "tc")):
            off = differ(of_side[name], own[event].to_numpy() / references.RATE_HZ)
            assert len(off) > 25
            assert np.abs(np.median(off)) < 0.012
            assert np.percentile(np.abs(off), 90) < 0.025


@needs_data
def test_the_foot_is_loaded_from_contact_to_toe_off() -> None:
    """The force of heel and toe rises 0.06 s after the heel touches, and falls 0.03 s after the toe turns fastest."""
    offs, shares = {"contact_s": [], "toe_off_s": []}, []
    for path in sorted((FOLDER / "feet_thighs").glob("*1?_?F.csv.gz")):
        strides = navigate(path, "inertial", options=Options(use_magnetometer=False, mount="foot")).to_dataframe(
            "strides"
        )
        strides = strides[strides["steady"]]
        t, *forces = np.loadtxt(path.with_name(path.name.replace("csv", "contact.txt"))).T
        low, high = np.percentile(forces, [2.0, 98.0], axis=1)
        loaded = (np.array(forces) > (low + 0.15 * (high - low))[:, None]).any(axis=0)
        for name, change in zip(offs, (1, -1), strict=True):
            offs[name].append(differ(strides[name], t[1:][np.diff(loaded.astype(int)) == change]))
        shares.append(strides["stance_share"])
    contact, toe_off = (np.concatenate(of) for of in offs.values())
    assert len(contact) > 30
    assert -0.08 < np.median(contact) < -0.04
    assert -0.05 < np.median(toe_off) < -0.01
    assert max(np.subtract(*np.percentile(off, [75, 25])) for off in (contact, toe_off)) < 0.03
    assert 0.58 < np.concatenate(shares).mean() < 0.68
