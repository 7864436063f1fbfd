"""The real recordings of every format: sizes, gravity, truth, and axes that agree with each other."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fg_nav.detection.stance import Stances
from fg_nav.errors import FormatError
from fg_nav.io import read, read_raw, read_truth
from fg_nav.lab.pyshoe import read_pyshoe_labels, read_pyshoe_track
from fg_nav.mechanisation import rotate_in_body
from fg_nav.recording import Recording
from fg_nav.samples.plausibility import measure_gravity_transport, measure_rest_acc
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from tests.io.test_every_format import WITHOUT_GRAVITY
from tests.real_data import DATA, needs_data

pytestmark = needs_data


PATTERNS = ("gdin/*/*.csv", "vicon/*.mat", "gdlbio/*.mat", "openshoe/*.txt", "xio/*.csv", "broad/*.mat")
FILES = [] if DATA is None else [path for pattern in PATTERNS for path in sorted(DATA.glob(pattern))]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
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


SIZES = """
gdin/own/SensorConnectData_31.csv                                sensorconnect     8549 200.0 47.4 1.000 33
gdin/own/SensorConnectData_33.csv                                sensorconnect    11000 200.0 42.0 1.000 47
gdin/own/SensorConnectData_43.csv                                sensorconnect    15500 250.0 -    -     60
gdin/own_obsolete/SensorConnectData_15.csv                       sensorconnect    19001 200.0 45.4 1.000 73
gdin/own_obsolete/SensorConnectData_29.csv                       sensorconnect    21001 200.0 44.0 1.000 100
gdlbio/SensorConnectData_48_GDLBIO.mat                           gdlbio            1864 200.0 -    -     8
gdlbio/SensorConnectData_62_GDLBIO.mat                           gdlbio           10600 200.0 -    -     37
gdlbio/SensorConnectData_66_GDLBIO.mat                           gdlbio            9000 200.0 -    -     48
vicon/2017-11-22-11-22-03.mat                                    pyshoe            6490 200.0 -    -     path
broad/01_undisturbed_slow_rotation_A.mat                         broad            56940 285.7 43.3 0.709 path
openshoe/data_inert1.txt                                         openshoe         16420 250.0 48.0 0.970 -
openshoe/data_inert7.txt                                         openshoe         16540 250.0 48.0 0.971 -
xio/short_walk.csv                                               xio              16334 398.3 -    -     -
formats/phyphox/test_case4                                       phyphox           9949  52.4 54.6 0.953 -
formats/phyphox-derived/semicolon-decimal-comma                  phyphox            398  10.0 48.0 1.000 -
formats/phyphox-derived/tab-decimal-comma                        phyphox            398  10.0 48.0 1.000 -
formats/sensor-logger-ios/2022-09-16_11-15-46.zip                sensor-logger     2064 100.4 -    -     -
formats/sensor-logger-ios-uncal                                  sensor-logger     2705  99.9 -    -     -
formats/sensor-logger-android                                    sensor-logger     4039 101.5 36.4 0.494 -
formats/physics-toolbox/INPUT_N.csv                              physics-toolbox    646  14.7 -    -     -
formats/hyperimu/short_y_impulse.csv                             hyperimu           371  43.5 -    -     -
formats/xsens-mt-manager/old_data_xsens.txt                      xsens              953  50.0 59.3 1.000 -
formats/xsens-dot/recording_bei_D4CA6EF17860_20210830_170505.csv xsens-dot         1952 120.0 -    -     -
formats/movesense/MovesenseLog_3_786.json                        movesense         3600 102.6 -    -     -
formats/metawear                                                 metawear           411  25.0 -    -     -
formats/yei-3space/data_yei.txt                                  yei               2715 109.9 53.4 1.000 -
formats/shimmer-consensys/devicely_read_test_data.csv            shimmer             90  51.2 43.8 1.000 -
formats/shimmer-consensys/Accelerometre_Carre.csv                shimmer           1163 100.0 46.2 1.000 -
formats/vectornav-vn310/Static-vn310-imu.csv                     vectornav          690  20.0 21.8 1.000 -
formats/rosbag1/sparkfun_razor.bag                               ros               2144  69.0 -    -     -
formats/ros2-converted/razor_db3                                 ros               2144  69.0 -    -     -
formats/ros2-converted/razor_mcap/razor_mcap.mcap                ros               2144  69.0 -    -     -
"""
"""File, format, samples, rate in Hz, strength of the field in uT and share of samples with one, and the truth."""


@pytest.mark.parametrize("line", SIZES.strip().splitlines(), ids=lambda line: line.split()[0])
def test_sizes(line: str) -> None:
    place, format, samples, rate_hz, field_uT, share, known = line.split()
    if format == "ros":
        pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
    recording = read(DATA / place)
    assert (recording.provenance.format, len(recording)) == (format, int(samples))
    assert 1.0 / recording.period_s == pytest.approx(float(rate_hz), abs=0.06)
    if place.startswith("formats"):  # where nobody walks fast
        assert np.median(np.linalg.norm(recording.acc, axis=1)) == pytest.approx(9.8, abs=0.4)
    assert (recording.mag is None) == (field_uT == "-")
    if recording.mag is not None:
        strength = np.linalg.norm(recording.mag, axis=1)
        assert np.nanmedian(strength) == pytest.approx(float(field_uT), abs=0.06)
        assert np.isfinite(strength).mean() == pytest.approx(float(share), abs=2e-3)
    truth = recording.truth
    if known == "-":
        assert truth is None
    elif known == "path":
        assert isinstance(truth, TrajectoryTruth)
    else:
        assert isinstance(truth, FootprintTruth)
        assert (truth.stride_count, truth.stride[0], truth.stride[-1]) == (int(known), 0, int(known))
        assert 0.3 < np.linalg.norm(np.diff(truth.xy, axis=0), axis=1).sum() / int(known) < 2.5
        beside = (DATA / place).with_suffix(".mat")
        np.testing.assert_array_equal(read_truth(beside).xy, truth.xy)
    if format == "gdlbio":
        assert len(read_pyshoe_track(DATA / place)) == len(recording)
        turning = np.linalg.norm(recording.gyr, axis=1)
        standing = turning[np.searchsorted(recording.t, truth.t)]
        assert np.median(standing) < 0.4 * np.median(turning)


def test_files_that_leave_something_to_choose() -> None:
    mt = read_raw(DATA / "formats/xsens-mt-manager/MT2022_ACC_GYRO_ROT_MAT_SPACE_00B42D4B.txt", rate_hz=100.0)
    assert mt.acc[0, 2] > 9.8
    assert len(read_raw(DATA / "formats/apdm-csv/apdm_format7.csv", sensor="Left Foot").t) == 3


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


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ("qmt_fullbody/full_body_example_data.mat", "no column for acceleration among 't'"),
        ("gdin/own/SensorConnectData_31.mat", "surveyed footprints"),
        ("formats/sensor-logger-ios-mag", WITHOUT_GRAVITY),
        ("formats/sensor-logger-ios/2022-09-09_13-14-55", "no gyroscope"),
        ("formats/phyphox-semicolon", "give the files of one experiment"),
        ("formats/androsensor/Upstairs1.csv", "2 samples a second"),
        ("formats/gnss-logger/pixel6.txt", "0.0177 samples a second, too few"),
        ("formats/xsens-dot-pcsdk/logfile_CustomMode4.csv", "whether its gyroscope is in deg/s or rad/s"),  # on a desk
    ],
)
def test_files_that_hold_too_little_are_refused(place: str, words: str) -> None:
    with pytest.raises(FormatError, match=words):
        read(DATA / place)
