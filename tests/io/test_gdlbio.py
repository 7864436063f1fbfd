"""Surveyed walks of gdlbio: footprints with their instants, right-handed, and one sentence for each defect."""

from pathlib import Path

import numpy as np
import pytest

from fg_nav.errors import FormatError
from fg_nav.io import read, read_raw, read_truth
from fg_nav.lab.pyshoe import read_pyshoe_track
from fg_nav.truth import FootprintTruth
from tests.io.samples import tilting, write_gdlbio
from tests.real_data import DATA, needs_data

RAW = tilting(np.random.default_rng(1))


def test_footprints_are_made_right_handed_and_have_their_times(tmp_path: Path) -> None:
    path = tmp_path / "walk.mat"
    write_gdlbio(RAW, path)
    truth, t = read(path).truth, RAW.t[::100]
    assert isinstance(truth, FootprintTruth)
    np.testing.assert_allclose(truth.t, t)
    np.testing.assert_allclose(truth.xy, np.column_stack([t, 2.0 * t]))
    np.testing.assert_array_equal(truth.stride, np.arange(len(t)))
    assert truth.stride_count == len(t) - 1
    np.testing.assert_allclose(read_pyshoe_track(path), np.column_stack([RAW.t, 2.0 * RAW.t]))
    np.testing.assert_allclose(read_truth(path).xy, truth.xy)


def test_times_of_footprints_move_with_the_stamps_that_are_evened(tmp_path: Path) -> None:
    path, rng = tmp_path / "walk.mat", np.random.default_rng(2)
    write_gdlbio(RAW, path, timestamps=RAW.t + rng.uniform(0.0, 1e-3, len(RAW.t)))
    recording = read(path)
    assert isinstance(recording.truth, FootprintTruth)
    np.testing.assert_allclose(recording.truth.t, recording.t[::100], atol=1e-9)


def test_footprints_lose_their_times_where_the_clock_began_again(tmp_path: Path) -> None:
    path, middle = tmp_path / "walk.mat", len(RAW.t) // 2
    write_gdlbio(RAW, path, timestamps=np.concatenate([RAW.t[:middle], RAW.t[: len(RAW.t) - middle]]))
    recording = read(path)
    assert isinstance(recording.truth, FootprintTruth)
    assert recording.truth.t is None
    assert any("the clock beg" in note for note in recording.provenance.notes)


def test_a_walk_may_have_no_footprints_and_each_defect_is_one_sentence(tmp_path: Path) -> None:
    path, count = tmp_path / "walk.mat", len(RAW.t[::100])
    write_gdlbio(RAW, path, GCP=None, pyshoeTrajectory=None)
    assert read(path).truth is None
    for reader, words in ((read_truth, "neither footprints nor a true path"), (read_pyshoe_track, "no variable 'pysh")):
        with pytest.raises(FormatError, match=words):
            reader(path)
    rising = "rising samples of the recording"
    for changes, message in (
        ({"imu_data": None}, "no variable 'imu_data'"),
        ({"timestamps": None}, "no variable 'timestamps'"),
        ({"imu_data": np.zeros((900, 5))}, r"shape \(900, 5\), not \(N, 6\)"),
        ({"timestamps": RAW.t[:-1]}, "'timestamps' has"),
        ({"GCP": np.zeros((3, 2))}, "'GCP' has 3 rows, 'strideIndex'"),
        ({"GCP": np.full((count, 2), np.nan)}, "a footprint that is not finite"),
        *(
            ({"strideIndex": index}, rising)
            for index in (np.arange(count) * 1000, -np.ones(count), np.full(count, 7), np.arange(count) + 0.5)
        ),
    ):
        write_gdlbio(RAW, path, **changes)
        with pytest.raises(FormatError, match=message) as caught:
            read_raw(path)
        assert str(caught.value).startswith("walk.mat")
        assert str(caught.value).endswith(".")


@needs_data
@pytest.mark.parametrize(("number", "samples", "strides"), [(48, 1864, 8), (62, 10600, 37), (66, 9000, 48)])
def test_real_walks(number: int, samples: int, strides: int) -> None:
    path = DATA / "gdlbio" / f"SensorConnectData_{number}_GDLBIO.mat"
    recording, track = read(path), read_pyshoe_track(path)
    truth = recording.truth
    assert recording.provenance.format == "gdlbio"
    assert (len(recording), len(track)) == (samples, samples)
    assert isinstance(truth, FootprintTruth)
    assert truth.stride_count == strides
    assert truth.t is not None
    sample = np.searchsorted(recording.t, truth.t)
    turning = np.linalg.norm(recording.gyr, axis=1)
    assert np.median(turning[sample]) < 0.4 * np.median(turning)  # the foot stands there
    assert 0.6 < np.median(np.linalg.norm(np.diff(truth.xy, axis=0), axis=1)) < 2.5
