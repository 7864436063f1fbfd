"""The smoother of a walk in progress: it ends where the batch ends, with what it found of the sensor."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from fg_nav.calibration import MagnetometerCalibration
from fg_nav.detection import RestParameters, detect_stances, find_rests
from fg_nav.errors import EstimationError
from fg_nav.evaluation.comparison import align
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation.motion import Style
from fg_nav.online import smoother as online_smoother
from fg_nav.online.buffer import OnlineOptions, PartialWalk, ReportedFootfall, SampleBuffer, rows_of
from fg_nav.online.resolve import solve_so_far
from fg_nav.online.smoother import OnlineSmoother
from fg_nav.online.window import Window
from fg_nav.samples.readings import find_clipping_levels
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.parameters import FieldParameters
from tests.online.walks import (
    FOOTFALLS,
    farthest,
    fed,
    footfall_at,
    in_field,
    polished,
    short_walk,
    smoother_of,
    solve_only_at,
    spoil,
    whole,
)
from tests.simulated import corridor, straight_walk
from tests.smoother.walks import DEFAULT, FREE, NO_REST, Walk, demo, part


@pytest.mark.parametrize("with_field", [False, True])
def test_it_ends_where_the_batch_ends(with_field):
    table = whole(with_field).smoothed()
    batch = polished(in_field() if with_field else demo()).stances
    assert farthest(table, batch) < 0.10
    np.testing.assert_allclose(table.heading_sigma[-1], batch.heading_sigma[-1], rtol=0.1)
    np.testing.assert_allclose(table.position_sigma[-1, :2], batch.position_sigma[-1, :2], rtol=0.1)
    # Of the newest strides it is not known yet whether they are on a level floor.
    assert batch.position_sigma[-1, 2] < table.position_sigma[-1, 2] < 0.15
    # Line by line, and smoothed, it is near the truth; both agree at the last footfall.
    causal, truth = whole(with_field).causal(), corridor(seed=0).recording.truth.position[table.sample]
    for one in (causal, table):
        assert np.linalg.norm(align(one.position, truth).apply(one.position) - truth, axis=1).max() < 0.5
    np.testing.assert_allclose(causal.position[-1], table.position[-1], atol=1e-3)
    assert farthest(causal, table) > 1e-3


def test_a_solution_that_fails_late_leaves_no_trace(monkeypatch):
    solve_only_at(monkeypatch, 1, 4, 8)
    tables = []
    for owner, name, fails in ((online_smoother, "solve_from_start", 3), (Window, "_note_newest", 8)):
        with monkeypatch.context() as patched:
            calls = spoil(patched, owner, name, lambda number, *_, fails=fails: number == fails)
            tables.append(fed(demo(), footfalls=12).causal())
            assert len(calls) >= fails
    np.testing.assert_array_equal(tables[0].position, tables[1].position)
    np.testing.assert_array_equal(tables[0].position_cov, tables[1].position_cov)


def test_what_is_no_walk_is_refused():
    stances, online = demo().stances, smoother_of(demo())
    stop = int(stances.stop[0])
    first = footfall_at(stances.start[:1], stances.stop[:1], stop - 9)
    with pytest.raises(EstimationError, match="no footfall yet"):
        online.propagate(50)
    with pytest.raises(EstimationError, match="footfall 0 is not one"):
        online.add_footfall(first, stop - 2)
    broken, buffer = rows_of(demo().recording), SampleBuffer()
    broken[3, 1] = np.nan
    buffer.append(broken)
    online = OnlineSmoother(OnlineOptions(), buffer)
    with pytest.raises(EstimationError, match="not finite"):
        online.add_footfall(first, stop)
    assert (online.n_reported, online.latest) == (0, None)


# --- rests -----------------------------------------------------------------------------------------------------------


def test_a_long_standing_given_in_pieces_is_one_rest():
    walk = demo()
    last = walk.stances.n_footfalls - 1
    online = fed(walk, footfalls=last)
    ends = np.linspace(walk.stances.start[-1], walk.stances.stop[-1], 5).astype(int)
    for start, stop in pairwise(ends):
        continues = start > ends[0]
        online.add_footfall(footfall_at(np.array([start]), np.array([stop]), int(start + stop) // 2, continues), stop)
    in_pieces, batch = online.smoothed(), smooth(walk.recording, walk.stances).stances
    np.testing.assert_allclose(in_pieces.gyro_bias_sigma[-1], batch.gyro_bias_sigma[-1], rtol=0.15)
    np.testing.assert_allclose(in_pieces.position[last - 1], batch.position[last - 1], atol=0.1)


def test_the_end_of_the_samples_makes_no_rest():
    walk = short_walk()
    last = find_rests(walk)[-1]
    assert len(walk) - last.start > 150
    recording = walk.slice(0, last.start + 50)
    stances, rests = detect_stances(recording), find_rests(recording)
    assert rests[-1].stop > len(recording) - 25
    assert not rests[-1].lasts(recording, RestParameters().shortest_s)
    for has_ended in (False, True):
        found = solve_so_far(recording, stances, OnlineOptions(use_field=False), has_ended=has_ended).walk.problem
        expected = rests if has_ended else rests[:-1]
        assert [rest.start for rest in found.known.rests] == [rest.start for rest in expected]


def test_the_field_of_a_standing_counts_once_however_it_is_cut():
    walk = in_field()
    stances, still = walk.stances, walk.stances.stillest(walk.recording.gyr)
    online = smoother_of(walk, OnlineOptions(parameters=SmootherParameters(magnetic=FieldParameters(gate="none"))))
    for k in range(12):
        of = stances.footfall == k
        start, stop = stances.start[of][0], stances.stop[of][-1]
        for begin, end in pairwise(np.linspace(start, stop, 4 if k in (0, 11) else 2).astype(int)):
            inside = int(still[k] if begin <= still[k] < end else (begin + end) // 2)
            piece = footfall_at(np.array([begin]), np.array([end]), inside, begin > start)
            online.add_footfall(piece, int(end) + 5)
    assert online.n_reported == 16
    assert online.window.to_anchor().counts["magnetic_heading"] == 12


def test_a_bias_beyond_its_prior_widens_it_as_in_batch():
    """A degree per second more on every axis, and no rest: the last re-solve has the prior that its walk shows."""
    walk = part(demo(), FOOTFALLS)
    off = Walk(replace(walk.recording, gyr=walk.recording.gyr + np.radians(1.0)), walk.stances)
    p = SmootherParameters(rest=RestParameters(shortest_s=1e3, shortest_at_end_s=1e3))
    online, batch = fed(off, OnlineOptions(parameters=p)), smooth(off.recording, off.stances, p, 0.0)
    last, expected = (
        float(note.removeprefix("gyro bias of ").partition(" ")[0])
        for notes in (online.initial.notes, batch.notes)
        for note in notes
        if "deg/s before the walk, one sigma" in note
    )
    assert expected > 0.5
    assert last == pytest.approx(expected, rel=0.2)  # of some footfalls less


def test_between_re_solves_clipped_peaks_are_as_high_as_the_walk_showed():
    run = straight_walk(style=Style.RUN, strides=20, seed=1).recording
    recording = replace(run, gyr=np.clip(run.gyr, -8.9, 8.9))
    walk = Walk(recording, detect_stances(recording))
    online = fed(walk, footfalls=18)
    assert online.initial.stance.number < 17
    height, window = online.walk.sensor.peak_height, online.walk.cut_recording(0)
    rise = walk.recording.peaks[1].whole - walk.recording.gyr
    assert height > 1.0
    assert rise.any()
    np.testing.assert_allclose(window.peaks[1].whole - window.gyr, height * rise[: len(window)], atol=1e-9)
    # So the strides since are those of the batch.
    given = [*vars(part(walk, 18)).values()]
    batch, low = (smooth(*given, p).stances for p in (FREE, replace(FREE, choose_swing_noise=False)))
    own, expected, by_flanks = (np.diff(table.position[-3:], axis=0) for table in (online.smoothed(), batch, low))
    worth = np.linalg.norm(by_flanks - expected, axis=1)  # 2 cm a stride of 2.3 m
    assert (np.linalg.norm(own - expected, axis=1) < 0.4 * worth).all()


# --- the differential field ------------------------------------------------------------------------------------------

WITHOUT_REST = replace(DEFAULT, rest=NO_REST)


@pytest.mark.parametrize(("parameters", "heading"), [(DEFAULT, None), (WITHOUT_REST, 0.0)])
def test_a_stride_extends_the_graph_and_is_never_solved_in_batch_instead(monkeypatch, parameters, heading):
    """Neither by what is behind the schedule nor by a graph that had to begin again."""
    solve_only_at(monkeypatch, 1, 2, 3, 4, 8)
    solved_again = spoil(monkeypatch, online_smoother, "solve_from_start")
    others = spoil(monkeypatch, Window, "_begin_again")
    online = fed(in_field(), OnlineOptions(heading_rad=heading, parameters=parameters), 24)
    assert online.initial.counts["differential_field"] > 0
    assert (len(solved_again), len(others)) == (5, 0)


def test_a_walk_finds_the_bias_by_it_at_its_end_as_the_batch_does():
    given = replace(WITHOUT_REST, gyr_density_deg_s=0.015)  # noise of the simulated gyroscope
    alone = replace(DEFAULT.magnetic, compass=False, potential=False)
    with_it, without = (replace(given, magnetic=replace(alone, differential=used)) for used in (True, False))
    online, other = (fed(in_field(), OnlineOptions(parameters=one)) for one in (with_it, without))
    for one in (online, other):
        one.begin_end()
        one.take_end()
    table, inertial = online.smoothed(), other.smoothed()
    batch = polished(in_field(), OnlineOptions(parameters=with_it)).stances
    middle = FOOTFALLS // 2
    assert online.initial.counts["differential_field"] > 2
    truth = corridor(seed=0).gyro_bias
    assert (np.abs(table.gyro_bias - truth)[middle] < 3.0 * table.gyro_bias_sigma[middle]).all()
    assert (np.abs(table.gyro_bias - batch.gyro_bias)[middle] < batch.gyro_bias_sigma[middle]).all()
    np.testing.assert_allclose(table.gyro_bias_sigma[middle], batch.gyro_bias_sigma[middle], rtol=0.25)
    # The field takes a tenth of the sigma about the vertical, as in batch (0.90 of it is left).
    assert table.gyro_bias_sigma[middle, 2] < 0.92 * inertial.gyro_bias_sigma[middle, 2]


# --- iron ------------------------------------------------------------------------------------------------------------

IRON_UT = np.array([14.0, -9.0, 20.0])


def test_iron_is_found_by_the_walk_which_ends_where_the_batch_ends():
    walk = Walk(replace(in_field().recording, mag=in_field().recording.mag + IRON_UT), in_field().stances)
    online = fed(walk)
    iron = online.walk.sensor.iron
    assert (np.abs(iron.hard_iron_uT - IRON_UT) < 4.0 * iron.sigma[:3]).all()
    assert any("corrected by the walk itself" in note for note in online.initial.notes)
    assert farthest(online.smoothed(), polished(walk).stances) < 0.10
    weight = online.smoothed().compass_weight
    assert weight.shape == (FOOTFALLS,)
    assert ((weight > 0.0) & (weight <= 1.0)).all()
    assert 0.3 < (weight == 1.0).mean() < 0.9
    # A part is corrected, and the whole is not.
    raw, stop = rows_of(walk.recording)[:, 7:10], online.walk.stop
    np.testing.assert_array_equal(online.walk.cut_whole().mag, raw[:stop])
    corrected = iron.correct(raw[stop - 500 : stop])
    np.testing.assert_array_equal(online.walk.cut_recording(stop - 500).mag, corrected)
    # With a calibration the samples stay as they are.
    given = MagnetometerCalibration("loop", IRON_UT, np.eye(3), 0.01 * np.eye(9), 48.0, 1.0, 1000)
    online = fed(walk, OnlineOptions(calibration=given), 12)
    assert online.walk.sensor.iron is None
    stop = online.walk.stop
    np.testing.assert_array_equal(online.walk.cut_recording(stop - 500).mag, raw[stop - 500 : stop])
    assert not any("by the walk itself" in note for note in online.initial.notes)


# --- where the sensor clips ------------------------------------------------------------------------------------------


RATE_HZ = 100.0


def moving(seconds: float, seed: int = 0) -> np.ndarray:
    """Specific force (n, 3) of a foot that is thrown about at random, 12 m/s^2 rms."""
    rng, n = np.random.default_rng(seed), round(seconds * RATE_HZ)
    smooth = gaussian_filter1d(rng.standard_normal((n, 3)), 5.0, axis=0)
    return np.asarray(12.0 * smooth / smooth.std())


def walk_of(*parts: np.ndarray) -> PartialWalk:
    """A walk of one footfall for each part, cut out as a whole behind the first."""
    walk, at = PartialWalk(SampleBuffer()), 0
    for k, acc in enumerate(parts):
        t, n = (at + np.arange(len(acc))) / RATE_HZ, len(acc)
        walk.buffer.append(np.column_stack([t, acc, np.full((n, 3), 0.01), np.full((n, 3), np.nan)]))
        walk.add(ReportedFootfall(footfall_at(np.array([at + 5]), np.array([at + n]), at + 6), k, at + n))
        at += n
        if k == 0:
            walk.cut_whole()
    return walk


def test_who_stands_does_not_clip_and_a_part_clips_where_the_walk_did() -> None:
    # Gravity that is flat between two taps, as the top of a peak is that was cut.
    standing = np.tile([0.0, 0.0, GRAVITY_M_S2], (1200, 1)) + 0.008 * np.random.default_rng(1).standard_normal(
        (1200, 3)
    )
    for start in range(110, len(standing), 370):
        standing[start : start + 2] *= 0.96
    assert np.isfinite(find_clipping_levels(standing)).any()  # by itself it looks like it
    acc, _ = walk_of(moving(10.0), standing).cut_recording(1000).clipping
    assert np.isinf(acc).all()
    acc, _ = walk_of(np.clip(moving(60.0), -25.0, 25.0), moving(1.0, 1)).cut_recording(6000).clipping
    np.testing.assert_allclose(acc, 25.0, rtol=0.03)
