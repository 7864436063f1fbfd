"""The script that tunes the filters: what it minimises, how it searches, and what it keeps."""

from concurrent.futures import Future

import numpy as np
import pytest

from fg_nav.ekf.presets import PHYSICAL, TUNED, find_parameters
from fg_nav.errors import OutputError
from fg_nav.magnetic import DETECTORS
from fg_nav.magnetic.detectors import scale_detector
from fg_nav.recording import Recording
from fg_nav.truth import TrajectoryTruth
from tests.scripts import load_script

tune = load_script("tune_filters")


class Inline:
    """A pool that works at once."""

    def submit(self, call, *arguments):
        done = Future()
        done.set_result(call(*arguments))
        return done


class Bowl:
    """A bench whose loss is a quadratic valley, askew to its axes; it counts what it is asked."""

    cases = (None,)
    asked = 0

    def losses(self, trials):
        self.asked += len(trials)
        return [self.loss(**dict(trial.point)) for trial in trials]

    def loss(self, window, allowance, compass_sigma_deg):
        a, b = np.log(compass_sigma_deg / 30.0), np.log(allowance / 2.0)
        return a * a + b * b + 0.8 * a * b + 0.1 * (window - 2) ** 2


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(scope="module")
def walk(folder):
    return tune.find_walk(folder, "teaching-building", 7)


def test_the_search_finds_the_bottom_of_an_oblique_valley_and_says_how_flat_it_is(capsys):
    grid, bowl = tune.with_physical("ma2018", tune.COMPASS_GRID), Bowl()
    best = tune.search_starts(bowl, "ma2018", grid, rounds=9)
    assert best == {"compass_sigma_deg": 30.0, "allowance": 2.0, "window": 2}
    tune.print_star(bowl, "ma2018", best, grid)
    marked = [cell for cell in capsys.readouterr().out.split() if cell.endswith("*")]
    assert marked == ["1.000*"] * 3


@pytest.mark.parametrize(
    ("losses", "words"),
    [
        ([0.5, 0.0, 0.4], "peak"),
        ([0.01, 0.0, 0.4], "slope"),
        ([0.01, 0.0, 0.01], "plateau"),
        ([0.0, 0.01, 0.3], "plateau, at the edge"),
        ([0.3, 0.2, 0.0], "peak, at the edge"),
    ],
)
def test_where_the_best_lies(losses, words):
    assert tune.name_shape(losses) == words


def test_the_search_begins_at_the_physical_preset_and_can_all_but_turn_the_compass_off():
    for method, grid in tune.GRIDS.items():
        start = tune.physical(method, grid)
        assert all(start[name] in values for name, values in tune.with_physical(method, grid).items())
        assert max(grid["compass_sigma_deg"]) >= 90.0
        assert tune.set_point(find_parameters(method, PHYSICAL), start) == find_parameters(method, PHYSICAL)


def test_an_allowance_lets_pass_what_is_that_many_times_larger():
    detector = DETECTORS["ma2018"]
    window = np.random.default_rng(1).normal(size=(50, 3, detector.rows)) * 3.0
    wider = scale_detector(detector, 2.0)
    sigma, wide = (np.array([c.sigma for c in d.channels])[:, None] for d in (detector, wider))
    passes = detector.compute_statistic(window / sigma) < detector.threshold
    assert np.array_equal(passes, wider.compute_statistic(2.0 * window / wide) < wider.threshold)
    assert scale_detector(detector, 1.0, 5).window == 5


def test_averaging_keeps_what_is_integrated_and_measured():
    rng, n = np.random.default_rng(2), 403
    t, acc, gyr, mag = np.arange(n) / 400.0, *rng.normal(size=(3, n, 3))
    mag[np.arange(n) % 3 > 0] = np.nan
    truth = TrajectoryTruth(t, np.column_stack([t, t, t]), np.tile(np.eye(3), (n, 1, 1)))
    slow = tune.average_samples(Recording(t, acc, gyr, mag, truth), 100.0)
    assert slow.period_s == pytest.approx(0.01)
    assert slow.acc.sum(axis=0) * 4 == pytest.approx(acc[:400].sum(axis=0))
    assert slow.gyr[7] == pytest.approx(gyr[28:32].mean(axis=0))
    assert slow.mag[1] == pytest.approx(mag[6])
    assert np.array_equal(slow.truth.position[:, 0], slow.t)
    whole = tune.average_samples(Recording(t, acc, gyr, mag, truth), np.inf)
    assert np.array_equal(whole.mag, mag, equal_nan=True)


def test_a_walk_comes_out_of_the_cache_as_it_went_in(walk, folder):
    again = tune.find_walk(folder, "teaching-building", 7)
    assert np.array_equal(again.recording.acc, walk.recording.acc)
    fresh = tune.simulate_walk("teaching-building", 7, tune.RATE_HZ)
    trial = tune.Trial("ma2018")
    assert tune.errors_m(trial, again, "smooth") == tune.errors_m(trial, fresh, "smooth")
    assert len(walk.truth) == walk.stances.n_footfalls == len(walk.fields["indoor"])


def test_a_compass_of_no_weight_is_the_iez_and_the_tuned_filters_are_better(walk):
    iez = sum(tune.errors_m(tune.Trial("iez"), walk, "smooth"))
    nothing = tune.Trial.at("ma2018", {"compass_sigma_deg": 1e6})
    assert sum(tune.errors_m(nothing, walk, "smooth")) == pytest.approx(iez, rel=1e-3)
    for method in tune.GRIDS:
        assert sum(tune.errors_m(tune.Trial(method, preset=TUNED), walk, "smooth")) < iez


def test_the_loss_is_the_mean_log_ratio_to_the_iez_and_results_are_kept(monkeypatch, tmp_path):
    counted = []

    def errors_m(trial, walk, field):
        counted.append((trial.method, walk, field))
        return (1.0, 3.0) if trial.method == "iez" else (0.5, 0.5 if field == "smooth" else 3.5)

    monkeypatch.setattr(tune, "find_walk", lambda folder, *of: of)
    monkeypatch.setattr(tune, "errors_m", errors_m)
    bench = tune.Bench(tmp_path, Inline(), ("office",), range(1, 3))
    assert bench.losses([tune.Trial("qsf")]) == [pytest.approx((np.log(1 / 4) + 0.0) / 2)]
    assert len(counted) == 2 * 2 * 2
    again = tune.Bench(tmp_path, Inline(), ("office",), range(1, 3))
    assert again.losses([tune.Trial("qsf"), tune.Trial("qsf")])[1] == pytest.approx(np.log(1 / 4) / 2)
    assert len(counted) == 2 * 2 * 2


def test_held_out_walks_are_printed_and_are_not_those_tuned_on(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(tune, "find_walk", lambda folder, *of: of)
    monkeypatch.setattr(tune, "errors_m", lambda trial, walk, field: (walk[1], 4.0))
    monkeypatch.setattr(tune, "ProcessPoolExecutor", lambda jobs: _Entered())
    tune.main(["--cache", str(tmp_path), "--held-out", "--seeds", "3", "--methods", "qsf", "--scenarios", "office"])
    printed = capsys.readouterr().out
    assert "seeds 31 to 33" in printed
    assert ["qsf", "tuned", "32.00", "4.00", "1.000", "1.000", "1.000"] in [row.split() for row in printed.splitlines()]
    assert tune.HELD_OUT > tune.FIRST_SEED + tune.MAX_SEEDS


class _Entered(Inline):
    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None


def test_a_cache_that_cannot_be_written_is_named(walk, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(tune, "simulate_walk", lambda *_: walk)
    with pytest.raises(OutputError, match="--cache"):
        tune.find_walk(tmp_path / "file", "office", 1)
