"""Stances of real walks: known stride counts, and motion capture of what the foot did meanwhile."""

import numpy as np
import pytest
from scipy.io import loadmat
from scipy.ndimage import gaussian_filter1d

from fg_nav.detection import detect_stances, find_rests
from fg_nav.io import read
from fg_nav.recording import Recording
from tests.real_data import DATA, needs_data

pytestmark = needs_data

CRAWLING = ("2018-02-09-11-16-53", "2018-02-09-11-19-39")  # On these the foot is dragged over the ground.


def count(recording):
    return detect_stances(recording).n_footfalls - 1


@pytest.mark.parametrize("number", [15, 18, 20, 22, 24, 29, 31, 33, 36, 40, 35, 43])
def test_stride_counts(number):
    recording = read(DATA / "gdin" / ("own" if number > 29 else "own_obsolete") / f"SensorConnectData_{number}.csv")
    assert abs(count(recording) - recording.truth.stride_count) <= (number not in (35, 43))


@pytest.mark.parametrize("number", [52, 54, 56, 60, 66, 68, 70])
def test_strides_of_runs_are_found_within_three_percent(number):
    """Indoor runs whose gyroscope clips in every stride; each stance was marked by hand."""
    walked = loadmat(DATA / "gdlbio" / f"SensorConnectData_{number}_GDLBIO.mat")
    samples = walked["imu_data"].astype(np.float64)
    recording = Recording(walked["timestamps"].ravel().astype(np.float64), samples[:, :3], samples[:, 3:])
    strides = walked["strideIndex"].size - 1
    assert abs(count(recording) - strides) <= 0.03 * strides


def test_the_foot_stands_in_stances_and_every_stop_of_the_foot_is_found():
    """In each stance of walking and running there is an instant at which the foot hardly moves by motion capture.

    Where the true speed stays below 3 cm/s for 0.1 s, there is a stance.
    """
    least, missed, total, paths = [], 0, 0, sorted((DATA / "vicon").glob("*.mat"))
    for path in paths:
        recording = read(path)
        truth, stances = recording.truth, detect_stances(recording)
        smooth = gaussian_filter1d(truth.position, 3, axis=0)  # millimetres of noise at 5 ms
        speed = np.interp(recording.t, truth.t, np.linalg.norm(np.gradient(smooth, truth.t, axis=0), axis=1))
        if path.stem not in CRAWLING:
            least += [speed[a:b].min() for a, b in zip(stances.start, stances.stop, strict=True)]
        stopped = np.lib.stride_tricks.sliding_window_view(speed < 0.03, 20).all(axis=1)
        begin = np.flatnonzero(np.diff(stopped.astype(int)) == 1) + 1
        total += len(begin)
        missed += sum(not stances.mask[i : i + 20].any() for i in begin)
    assert len(paths) == 28
    assert max(least) < 1.0
    assert np.mean(np.array(least) < 0.2) > 0.98
    assert np.median(least) < 0.02
    assert total > 300
    assert missed <= 0.02 * total


def test_rests_agree_on_the_bias():
    off, sigma = [], []
    for path in (*(DATA / "openshoe").glob("*.txt"), *(DATA / "xio").glob("*.csv"), *(DATA / "vicon").glob("*.mat")):
        rests = find_rests(read(path))
        best = min(rests, key=lambda rest: np.linalg.norm(rest.sigma), default=None)
        off += [np.degrees(rest.rate - best.rate) for rest in rests if rest is not best]
        sigma += [np.degrees(np.hypot(rest.sigma, best.sigma)) for rest in rests if rest is not best]
    off_deg_s, sigma_deg_s = np.abs(off), np.array(sigma)
    assert len(off_deg_s) >= 10
    assert off_deg_s[sigma_deg_s < 0.2].max() < 0.5
    assert np.median(off_deg_s.max(axis=1)) < 0.15
    assert 0.4 < np.sqrt(np.mean((off_deg_s / sigma_deg_s) ** 2)) < 1.4
