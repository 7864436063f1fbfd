"""A walk in progress: it ends where the batch ends, answers the same however it is fed, and goes on."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from fg_nav.detection import RestParameters, detect_stances, find_rests
from fg_nav.detection.causal import Footfall
from fg_nav.errors import EstimationError
from fg_nav.evaluation.comparison import align
from fg_nav.lab.simulation.motion import Style
from fg_nav.online import smoother as online_smoother
from fg_nav.online.buffer import OnlineOptions, SampleBuffer, rows_of
from fg_nav.online.resolve import measure_online_field, solve_so_far
from fg_nav.online.smoother import OnlineSmoother
from fg_nav.online.window import Window
from fg_nav.smoother import SmootherParameters, smooth
from fg_nav.smoother.parameters import FieldParameters
from tests.online.walks import short_walk, solve_only_at
from tests.simulated import corridor, straight_walk
from tests.smoother.walks import FREE, Walk, demo, part

FOOTFALLS = 40
EARTH = np.array([1.0, 20.0, -43.0])


@cache
def in_field() -> Walk:
    """The walk of `demo` with a magnetometer at 100 Hz in a field that has ripples a few metres long."""
    truth = corridor(seed=0).recording.truth
    ripple = 3.0 * np.sin(2.0 * truth.position[:, :2] + [0.0, 1.0])
    nav = EARTH + np.column_stack([ripple, np.zeros(len(ripple))])
    mag = np.einsum("nji,nj->ni", truth.nav_R_body, nav)
    mag += 0.2 * np.random.default_rng(1).standard_normal(mag.shape)
    mag[1::2] = np.nan
    walk = demo()
    return Walk(replace(walk.recording, mag=mag), walk.stances)


def fed(walk: Walk, options: OnlineOptions = OnlineOptions(), footfalls: int = FOOTFALLS, beyond: int = 5):
    """Feed the footfalls of a walk, each with some samples beyond it."""
    online = smoother_of(walk, options)
    for k in range(footfalls):
        add(online, walk, k, beyond)
    return online


def smoother_of(walk: Walk, options: OnlineOptions = OnlineOptions()) -> OnlineSmoother:
    """A smoother with all samples of a walk in its buffer."""
    buffer = SampleBuffer()
    buffer.append(rows_of(walk.recording))
    return OnlineSmoother(options, buffer)


def add(online: OnlineSmoother, walk: Walk, k: int, beyond: int = 5) -> int:
    """Add a footfall of a walk; the sample up to which it is known."""
    stances = walk.stances
    of = stances.footfall == k
    stop = int(stances.stop[of][-1]) + beyond
    still = int(stances.stillest(walk.recording.gyr)[k])
    online.add_footfall(footfall_at(stances.start[of], stances.stop[of], still), stop)
    return stop


def footfall_at(start: np.ndarray, stop: np.ndarray, stillest: int, continues: bool = False) -> Footfall:
    """A footfall of these intervals, of whatever threshold."""
    return Footfall(start, stop, np.ones(len(start)), stillest, continues)


def polished(walk: Walk, options: OnlineOptions = OnlineOptions()):
    """The batch on the same footfalls, without the gyroscope scale, which a walk in progress has not."""
    cut = part(walk, FOOTFALLS)
    recording, stances = cut.recording, cut.stances
    seen = measure_online_field(recording, stances, options)
    p = replace(options.parameters, gyro_scale=False)
    return smooth(seen.recording, stances, p, options.heading_rad, None, seen.field)


def farthest(table, other) -> float:
    return float(np.linalg.norm(table.position - other.position, axis=1).max())


@cache
def whole() -> OnlineSmoother:
    return fed(demo())


@cache
def whole_in_field() -> OnlineSmoother:
    return fed(in_field(), OnlineOptions())


@pytest.mark.parametrize(
    ("online", "given"),
    [(whole, (demo, OnlineOptions())), (whole_in_field, (in_field, OnlineOptions()))],
)
def test_it_ends_where_the_batch_ends(online, given):
    table = online().smoothed()
    batch = polished(given[0](), given[1]).stances
    assert farthest(table, batch) < 0.10
    np.testing.assert_allclose(table.heading_sigma[-1], batch.heading_sigma[-1], rtol=0.1)
    np.testing.assert_allclose(table.position_sigma[-1, :2], batch.position_sigma[-1, :2], rtol=0.1)
    # Of the newest strides it is not known yet whether they are on a level floor.
    assert batch.position_sigma[-1, 2] < table.position_sigma[-1, 2] < 0.15
    # Line by line, and smoothed, it is near the truth; both agree at the last footfall.
    causal, truth = online().causal(), corridor(seed=0).recording.truth.position[table.sample]
    for one in (causal, table):
        assert np.linalg.norm(align(one.position, truth).apply(one.position) - truth, axis=1).max() < 0.5
    np.testing.assert_allclose(causal.position[-1], table.position[-1], atol=1e-3)
    assert farthest(causal, table) > 1e-3


def test_a_long_standing_given_in_pieces_is_one_rest():
    walk = demo()
    last = walk.stances.n_footfalls - 1
    online = fed(walk, footfalls=last)
    ends = np.linspace(walk.stances.start[-1], walk.stances.stop[-1], 5).astype(int)
    for start, stop in pairwise(ends):
        continues = start > ends[0]
        piece = footfall_at(np.array([start]), np.array([stop]), int(start + stop) // 2, continues)
        online.add_footfall(piece, stop)
    in_pieces, whole_walk = online.smoothed(), smooth(walk.recording, walk.stances).stances
    np.testing.assert_allclose(in_pieces.gyro_bias_sigma[-1], whole_walk.gyro_bias_sigma[-1], rtol=0.15)
    np.testing.assert_allclose(in_pieces.position[last - 1], whole_walk.position[last - 1], atol=0.1)


def test_a_solution_that_fails_late_leaves_no_trace(monkeypatch):
    solve_only_at(monkeypatch, 1, 4, 8)
    tables = []
    for owner, broken, fails in ((online_smoother, "solve_from_start", 3), (Window, "_note_newest", 8)):
        with monkeypatch.context() as patched:
            calls = failing_at(patched, owner, broken, fails)
            tables.append(fed(demo(), footfalls=12).causal())
            assert len(calls) > fails or broken == "solve_from_start"
    np.testing.assert_array_equal(tables[0].position, tables[1].position)
    np.testing.assert_array_equal(tables[0].position_cov, tables[1].position_cov)


def failing_at(monkeypatch, owner: object, name: str, call: int) -> list[int]:
    """Let one call of a function raise; a list that grows by one with each."""
    whole_of_it, calls = getattr(owner, name), []

    def failing(*given):
        calls.append(0)
        if len(calls) == call:
            raise RuntimeError("Indeterminate linear system detected")
        return whole_of_it(*given)

    monkeypatch.setattr(owner, name, failing)
    return calls


def test_what_is_no_walk_is_refused():
    recording, stances = demo().recording, demo().stances
    stop = int(stances.stop[0])
    first = footfall_at(stances.start[:1], stances.stop[:1], stop - 9)
    online = smoother_of(demo())
    with pytest.raises(EstimationError, match="no footfall yet"):
        online.propagate(50)
    with pytest.raises(EstimationError, match="footfall 0 is not one"):
        online.add_footfall(first, stop - 2)
    broken, buffer = rows_of(recording), SampleBuffer()
    broken[3, 1] = np.nan
    buffer.append(broken)
    online = OnlineSmoother(OnlineOptions(), buffer)
    with pytest.raises(EstimationError, match="not finite"):
        online.add_footfall(first, stop)
    assert online.n_reported == 0
    assert online.latest is None


def test_the_end_of_the_samples_makes_no_rest():
    walk = short_walk()
    last = find_rests(walk)[-1]
    assert len(walk) - last.start > 150
    recording = walk.slice(0, last.start + 50)
    stances, rests = detect_stances(recording), find_rests(recording)
    assert rests[-1].stop > len(recording) - 25
    assert not rests[-1].lasts(recording, RestParameters().shortest_s)
    solved = solve_so_far(recording, stances, OnlineOptions(use_field=False))
    assert [rest.start for rest in solved.walk.problem.known.rests] == [rest.start for rest in rests[:-1]]
    ended = solve_so_far(recording, stances, OnlineOptions(use_field=False), has_ended=True)
    assert [rest.start for rest in ended.walk.problem.known.rests] == [rest.start for rest in rests]


def test_the_field_of_a_standing_counts_once_however_it_is_cut():
    walk = in_field()
    stances, still = walk.stances, walk.stances.stillest(walk.recording.gyr)
    options = OnlineOptions(parameters=SmootherParameters(magnetic=FieldParameters(gate="none")))
    online = smoother_of(walk, options)
    for k in range(12):
        of = stances.footfall == k
        start, stop = stances.start[of][0], stances.stop[of][-1]
        cuts = np.linspace(start, stop, 4 if k in (0, 11) else 2).astype(int)
        for begin, end in pairwise(cuts):
            inside = still[k] if begin <= still[k] < end else (begin + end) // 2
            online.add_footfall(
                footfall_at(np.array([begin]), np.array([end]), int(inside), begin > start), int(end) + 5
            )
    assert online.n_reported == 16
    anchor = online.window.to_anchor()
    assert anchor.counts["magnetic_heading"] == 12


def test_a_bias_beyond_its_prior_widens_it_as_in_batch() -> None:
    """A degree per second more on every axis, and no rest: the last re-solve has the prior that its walk shows."""
    walk = part(demo(), FOOTFALLS)
    off = Walk(replace(walk.recording, gyr=walk.recording.gyr + np.radians(1.0)), walk.stances)
    p = SmootherParameters(rest=RestParameters(shortest_s=1e3, shortest_at_end_s=1e3))
    online, batch = fed(off, OnlineOptions(parameters=p)), smooth(off.recording, off.stances, p, 0.0)
    last, whole = (
        float(note.removeprefix("gyro bias of ").partition(" ")[0])
        for notes in (online.initial.notes, batch.notes)
        for note in notes
        if "deg/s before the walk, one sigma" in note
    )
    assert whole > 0.5
    assert last == pytest.approx(whole, rel=0.2)  # of some footfalls less


# --- what the walk showed so far -------------------------------------------------------------------------------------


@cache
def clipped_run() -> Walk:
    """A run whose rate is cut at 8.9 rad/s."""
    run = straight_walk(style=Style.RUN, strides=20, seed=1).recording
    cut = replace(run, gyr=np.clip(run.gyr, -8.9, 8.9))
    return Walk(cut, detect_stances(cut))


def test_between_re_solves_clipped_peaks_are_as_high_as_the_walk_showed():
    walk = clipped_run()
    online = fed(walk, footfalls=18)
    assert online.initial.stance.number < 17
    height, window = online.walk.sensor.peak_height, online.walk.cut_recording(0)
    rise = walk.recording.peaks[1].whole - walk.recording.gyr
    assert height > 1.0
    assert rise.any()
    np.testing.assert_allclose(window.peaks[1].whole - window.gyr, height * rise[: len(window)], atol=1e-9)
    # So the strides since are those of the batch.
    batch = smooth(*vars(part(walk, 18)).values(), FREE).stances
    own, other = (np.diff(table.position[-3:], axis=0) for table in (online.smoothed(), batch))
    np.testing.assert_allclose(own, other, atol=5e-3)  # of strides of 2.3 m, each with the height of its time
