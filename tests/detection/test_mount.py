"""On a foot or in a pocket: by hand-made turning, on simulated and on real recordings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from fg_nav.detection.mount import measure_turning, refuse_foot, refuse_pocket
from fg_nav.errors import EstimationError
from fg_nav.inspection import inspect
from fg_nav.io import read
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.recording import RawRecording, Recording
from tests.real_data import DATA, needs_data

RATE_HZ = 100.0


def turning(rate_deg_s, impact_m_s2=40.0, stride_s=1.0, axis=(0.2, 0.9, -0.3), seconds=30.0):
    """A sensor whose rate about an axis is this function of the share of a stride; hit once a stride."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    share = (t / stride_s) % 1.0
    rng = np.random.default_rng(0)
    gyr = np.radians(rate_deg_s(share))[:, None] * np.asarray(axis) + 0.02 * rng.standard_normal((len(t), 3))
    gyr[:, 0] += np.radians(30.0) * np.sin(4 * np.pi * share) * (rate_deg_s(share) != 0)
    acc = np.tile([0.0, 0.0, 9.8], (len(t), 1))
    acc[np.abs(share - 0.6) < 0.02, 2] += impact_m_s2 - 9.8
    return Recording(t, acc, gyr)


def foot(peak):
    """Stands for four tenths of a stride; in between it turns to one side, and back."""
    return lambda share: np.where(share < 0.4, 0.0, peak * np.sin(2 * np.pi * (share - 0.4) / 0.6))


def thigh(peak):
    """Never rests."""
    return lambda share: peak * np.sin(2 * np.pi * share)


@pytest.mark.parametrize("peak", [250.0, 450.0, 700.0])
@pytest.mark.parametrize("stride_s", [0.8, 1.3])
def test_what_stands_in_every_stride_is_a_foot(peak, stride_s):
    recording = turning(foot(peak), stride_s=stride_s)
    assert measure_turning(recording).wearing == "foot"
    refuse_pocket(recording)
    with pytest.raises(EstimationError, match=r"on a foot.*leave --mount pocket out"):
        refuse_foot(recording)


@pytest.mark.parametrize("peak", [120.0, 180.0, 300.0])
@pytest.mark.parametrize("stride_s", [0.8, 1.3])
def test_what_swings_and_never_rests_is_a_thigh(peak, stride_s):
    recording = turning(thigh(peak), stride_s=stride_s)
    assert measure_turning(recording).wearing == "pocket"
    refuse_foot(recording)
    with pytest.raises(EstimationError, match=r"trouser pocket.*--mount pocket"):
        refuse_pocket(recording)


@pytest.mark.parametrize(
    "recording",
    [
        turning(lambda share: 0.0 * share),
        turning(thigh(200.0), impact_m_s2=12.0),
        turning(thigh(700.0)),
        turning(thigh(200.0), seconds=5.0),
        turning(thigh(200.0), stride_s=4.0),
    ],
    ids=["lies", "is never hit", "is faster than a thigh", "is too short", "is too slow"],
)
def test_what_is_not_clear_is_not_refused(recording):
    assert measure_turning(recording).wearing is None
    refuse_foot(recording)
    refuse_pocket(recording)


def test_it_does_not_hang_on_the_mounting():
    recording = turning(thigh(200.0))
    turned = replace(recording, gyr=Rotation.from_rotvec([1.0, -2.0, 0.5]).apply(recording.gyr))
    one, other = measure_turning(recording), measure_turning(turned)
    assert other.rest_share == pytest.approx(one.rest_share)
    assert other.rhythm == pytest.approx(one.rhythm)


def test_the_signs_are_what_was_put_in():
    signs = measure_turning(turning(foot(450.0), axis=(0.0, 1.0, 0.0)))
    assert 0.38 < signs.rest_share < 0.55  # and the moments about each turning back
    assert signs.peak_deg_s == pytest.approx(450.0, rel=0.1)
    assert signs.rhythm > 0.95


@pytest.mark.parametrize("seed", [101, 102])
@pytest.mark.parametrize(
    ("scenario", "worn", "said"),
    [
        ("demo", "heel", "foot"),
        ("demo", "instep", "foot"),
        ("demo", "pocket", "pocket"),
        ("stairs", "pocket", "pocket"),
    ],
)
def test_simulated_walks(scenario, worn, said, seed):
    assert measure_turning(simulate(scenario, seed, Choices(worn=worn)).recording).wearing == said


@pytest.mark.parametrize(("worn", "said"), [("pocket", True), ("heel", False)])
def test_an_inspection_says_what_it_looks_like(worn, said):
    recording = simulate("demo", 101, Choices(worn=worn)).recording
    raw = RawRecording(recording.t, recording.acc, recording.gyr, np.arange(len(recording)) + 1, recording.mag)
    verdict = " ".join(inspect(raw).verdict)
    assert ("--mount pocket" in verdict) is said
    assert ("stances make" in verdict) is not said


def data():
    assert DATA is not None
    return DATA


@needs_data
def test_real_thighs_and_feet_of_one_subject():
    body = loadmat(data() / "qmt_fullbody/full_body_example_data.mat", squeeze_me=True, struct_as_record=False)
    used = (body["t"] > 40) & (body["t"] < 140)
    for segment, said in (("upper_leg", "pocket"), ("foot", "foot")):
        for side in ("left", "right"):
            sensor = body[f"{segment}_{side}"]
            assert measure_turning(Recording(body["t"][used], sensor.acc[used], sensor.gyr[used])).wearing == said


@needs_data
def test_real_feet_are_never_taken_for_thighs_and_nearly_always_for_feet():
    folders = ("gdin/own/*.csv", "gdin/own_obsolete/*.csv", "openshoe/*.txt", "vicon/*.mat", "xio/*.csv")
    files = [path for folder in folders for path in sorted(data().glob(folder))]
    said = [measure_turning(read(path)).wearing for path in files]
    assert len(said) > 40
    assert "pocket" not in said
    assert said.count("foot") >= len(said) - 5  # running, and crawling where the foot hardly turns


@needs_data
def test_what_is_moved_by_hand_is_neither():
    for path in sorted((data() / "broad").glob("*.mat")):
        assert measure_turning(read(path)).wearing is None, path.name


def test_a_recording_shorter_than_a_window_shows_nothing():
    assert measure_turning(turning(foot(300.0), seconds=1.0)).windows == 0
