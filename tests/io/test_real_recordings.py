"""The real recordings of every format: sizes, gravity, truth, and axes that agree with each other."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.stance import Stances
from fg_nav.errors import FormatError
from fg_nav.io import read, read_raw, read_truth
from fg_nav.lab.pyshoe import read_pyshoe_labels
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording
from fg_nav.samples.plausibility import measure_gravity_transport, measure_rest_acc
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from tests.real_data import DATA, needs_data

pytestmark = needs_data


def _files() -> list[Path]:
    if DATA is None:
        return []
    patterns = ("gdin/*/*.csv", "vicon/*.mat", "gdlbio/*.mat", "openshoe/*.txt", "xio/*.csv", "broad/*.mat")
    return [path for pattern in patterns for path in sorted(DATA.glob(pattern))]


@pytest.mark.parametrize("path", _files(), ids=lambda path: path.stem)
def test_every_file_is_read_and_obeys_physics(path: Path) -> None:
    recording = read(path)
    assert len(recording) > 1500
    assert 9 < recording.duration_s < 250
    assert measure_rest_acc(recording.acc, recording.period_s) == pytest.approx(9.81, abs=0.1)
    assert np.abs(recording.gyr).max() < 25
    transport = measure_gravity_transport(recording.acc, recording.gyr, recording.period_s)
    if transport.is_telling:
        assert 0.5 < transport.gain < 2.0
    if recording.mag is not None:
        assert 35 < np.nanmedian(np.linalg.norm(recording.mag, axis=1)) < 60


def test_sizes() -> None:
    for name, format, samples, rate_hz, mag_share, truth in (
        ("gdin/own/SensorConnectData_31.csv", "sensorconnect", 8549, 200, 1.0, FootprintTruth),
        ("gdin/own/SensorConnectData_43.csv", "sensorconnect", 15500, 250, None, FootprintTruth),
        ("gdin/own_obsolete/SensorConnectData_15.csv", "sensorconnect", 19001, 200, 1.0, FootprintTruth),
        ("vicon/2017-11-22-11-22-03.mat", "pyshoe", 6490, 200, None, TrajectoryTruth),
        ("openshoe/data_inert1.txt", "openshoe", 16420, 250, 0.97, type(None)),
        ("openshoe/data_inert7.txt", "openshoe", 16540, 250, 0.97, type(None)),
        ("xio/short_walk.csv", "xio", 16334, 398.3, None, type(None)),
        ("broad/01_undisturbed_slow_rotation_A.mat", "broad", 56940, 285.714, 0.708, TrajectoryTruth),
    ):
        recording = read(DATA / name)
        assert (recording.provenance.format, len(recording)) == (format, samples)
        assert 1 / recording.period_s == pytest.approx(rate_hz, rel=1e-3)
        assert isinstance(recording.truth, truth)
        share = None if recording.mag is None else float(np.mean(~np.isnan(recording.mag[:, 0])))
        assert share == (None if mag_share is None else pytest.approx(mag_share, abs=2e-3))


def test_gdin_footprints() -> None:
    for name, strides in (("own/SensorConnectData_33", 47), ("own_obsolete/SensorConnectData_29", 100)):
        truth = read(DATA / f"gdin/{name}.csv").truth
        assert isinstance(truth, FootprintTruth)
        assert (truth.stride_count, truth.stride[0], truth.stride[-1]) == (strides, 0, strides)
        assert 0.3 < np.linalg.norm(np.diff(truth.xy, axis=0), axis=1).sum() / strides < 2.0
        np.testing.assert_array_equal(read_truth(DATA / f"gdin/{name}.mat").xy, truth.xy)


def test_vicon_truth_turns_with_the_gyroscope() -> None:
    """Course and heading change together in right-handed axes, and oppositely in left-handed ones."""
    trials = [_course_and_heading(path) for path in sorted((DATA / "vicon").glob("*.mat"))[::2]]
    decisive = np.array([trial for trial in trials if max(trial) > 0.6])
    assert len(decisive) >= 6
    assert (decisive[:, 0] > decisive[:, 1]).all()
    assert decisive[:, 0].mean() > 3 * decisive[:, 1].mean()


def _course_and_heading(path: Path) -> tuple[float, float]:
    """Resultant lengths of course minus heading, and of course plus heading, over the strides of a trial."""
    recording = read(path)
    truth = recording.truth
    stances = Stances.from_mask(read_pyshoe_labels(path))
    middle = (stances.start + stances.stop) // 2
    step = np.diff(truth.position[middle], axis=0)
    turn = _turned(recording, stances)[middle]
    long = np.hypot(step[:, 0], step[:, 1]) > 0.4
    course, heading = np.arctan2(step[long, 1], step[long, 0]), 0.5 * (turn[1:] + turn[:-1])[long]
    if len(course) < 8 or np.ptp(heading) < 4.0:  # hardly any turn in this trial
        return 0.0, 0.0
    resultants = [float(abs(np.mean(np.exp(1j * (course - sign * heading))))) for sign in (1, -1)]
    return resultants[0], resultants[1]


def _turned(recording: Recording, stances: Stances) -> np.ndarray:
    """Angle (N,) turned about up, rad; from each stance on, the gyroscope carries up along."""
    step = np.diff(recording.t, prepend=recording.t[0])
    turn, angle = recording.gyr * step[:, None], np.zeros(len(recording))
    edges = [*stances.start.tolist(), len(recording)]
    for start, begin, stop in zip(edges, stances.stop.tolist(), edges[1:], strict=False):
        up, turned = recording.acc[start:begin].mean(axis=0), np.eye(3)
        up /= np.linalg.norm(up)
        angle[start:begin] = turn[start:begin] @ up
        for k in range(begin, stop):
            rotate_in_body(turned, *turn[k])
            angle[k] = turn[k] @ (up @ turned)
    return np.cumsum(angle)


def test_broad_truth_is_the_attitude_of_the_sensor() -> None:
    """At rest the true attitude takes specific force to up; and it turns as the gyroscope says."""
    for path in sorted((DATA / "broad").glob("*.mat"))[::3]:
        recording = read(path)
        truth = recording.truth
        index = np.searchsorted(recording.t, truth.t)
        nav_acc = np.einsum("nij,nj->ni", truth.nav_R_body, recording.acc[index])
        up = np.median(nav_acc, axis=0)
        np.testing.assert_allclose(up / np.linalg.norm(up), [0, 0, 1], atol=0.03)
        near = np.flatnonzero(np.diff(index) == 1)[::50]
        turned = np.transpose(truth.nav_R_body[near], (0, 2, 1)) @ truth.nav_R_body[near + 1]
        rate = Rotation.from_matrix(turned).as_rotvec() / recording.period_s
        fast = np.linalg.norm(rate, axis=1) > 1.0
        if np.count_nonzero(fast) > 20:
            aligned = np.sum(rate[fast] * recording.gyr[index[near[fast]]], axis=1)
            assert np.median(aligned / np.sum(rate[fast] ** 2, axis=1)) == pytest.approx(1.0, abs=0.1)


def test_a_cut_line_of_openshoe_and_repeats_of_xio_are_dropped() -> None:
    recording = read(DATA / "openshoe/data_inert7.txt")
    assert recording.provenance.notes == ("left out 1 missing sample, the first in row 16541",)
    raw, recording = read_raw(DATA / "xio/short_walk.csv"), read(DATA / "xio/short_walk.csv")
    assert len(raw.t) - len(recording) == 205
    assert (np.diff(recording.t) > 0).all()
    assert recording.provenance.notes[0] == "left out 205 repeated stamps, the first in row 4"


def test_other_matlab_files_are_refused() -> None:
    with pytest.raises(FormatError, match="no column for acceleration among 't'"):
        read(DATA / "qmt_fullbody/full_body_example_data.mat")
    with pytest.raises(FormatError, match="surveyed footprints"):
        read(DATA / "gdin/own/SensorConnectData_31.mat")
