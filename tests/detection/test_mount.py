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


def test_what_stands_in_every_stride_is_a_foot_and_what_swings_and_never_rests_a_thigh():
    upside_down = Rotation.from_rotvec([1.0, -2.0, 0.5])
    for stride_s in (0.8, 1.3):
        for motion, peaks, wearing in ((foot, (250.0, 450.0, 700.0), "foot"), (thigh, (120.0, 180.0, 300.0), "pocket")):
            for peak in peaks:
                recording = turning(motion(peak), stride_s=stride_s)
                signs = measure_turning(recording)
                assert signs.wearing == wearing
                other = measure_turning(replace(recording, gyr=upside_down.apply(recording.gyr)))
                assert (other.rest_share, other.rhythm) == pytest.approx((signs.rest_share, signs.rhythm), abs=0.005)
    for motion, taken, refuse, words in (
        (foot(450.0), refuse_pocket, refuse_foot, r"on a foot.*leave --mount pocket out"),
        (thigh(180.0), refuse_foot, refuse_pocket, r"trouser pocket.*--mount pocket"),
    ):
        taken(turning(motion))
        with pytest.raises(EstimationError, match=words):
            refuse(turning(motion))
    signs = measure_turning(turning(foot(450.0), axis=(0.0, 1.0, 0.0)))
    assert 0.38 < signs.rest_share < 0.55  # and the moments about each turning back
    assert signs.peak_deg_s == pytest.approx(450.0, rel=0.1)
    assert signs.rhythm > 0.95


def test_what_is_not_clear_is_not_refused():
    for what, recording in {
        "lies": turning(lambda share: 0.0 * share),
        "is never hit": turning(thigh(200.0), impact_m_s2=12.0),
        "is faster than a thigh": turning(thigh(700.0)),
        "is too short": turning(thigh(200.0), seconds=5.0),
        "is too slow": turning(thigh(200.0), stride_s=4.0),
        "is shorter than a window": turning(foot(300.0), seconds=1.0),
    }.items():
        assert measure_turning(recording).wearing is None, what
        refuse_foot(recording)
        refuse_pocket(recording)


@pytest.mark.parametrize(
    ("scenario", "worn"), [("demo", "heel"), ("demo", "instep"), ("demo", "pocket"), ("stairs", "pocket")]
)
def test_simulated_walks_and_what_an_inspection_says_of_them(scenario, worn):
    for seed in (101, 102):
        recording = simulate(scenario, seed, Choices(worn=worn)).recording
        assert measure_turning(recording).wearing == ("pocket" if worn == "pocket" else "foot")
    raw = RawRecording(recording.t, recording.acc, recording.gyr, np.arange(len(recording)) + 1, recording.mag)
    verdict = " ".join(inspect(raw).verdict)
    assert ("--mount pocket" in verdict) == (worn == "pocket")
    assert ("stances make" in verdict) == (worn != "pocket")


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
def test_real_feet_are_never_taken_for_thighs_and_nearly_always_for_feet_and_a_hand_for_neither():
    folders = ("gdin/own/*.csv", "gdin/own_obsolete/*.csv", "openshoe/*.txt", "vicon/*.mat", "xio/*.csv")
    files = [path for folder in folders for path in sorted(data().glob(folder))]
    said = [measure_turning(read(path)).wearing for path in files]
    assert len(said) > 40
    assert "pocket" not in said
    assert said.count("foot") >= len(said) - 5  # running, and crawling where the foot hardly turns
    assert not any(measure_turning(read(path)).wearing for path in (data() / "broad").glob("*.mat"))
