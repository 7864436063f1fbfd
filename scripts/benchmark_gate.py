"""Is this state of the code slower, or further off, than the committed one? Metrics against a baseline.

    python scripts/benchmark.py --gate [--quick] [--baseline FILE]     exit code 1 where a metric is worse
    python scripts/benchmark.py [--quick] --save                       write it, `docs/results/benchmark.json`

Each metric has a unit, the direction that is better, and a tolerance: a share of the baseline by which it may be worse.
Times are ratios within one run, of processor times on the same samples, and the median over the repeats counts, so that
another machine or what else it does changes them little: `SPEED` is what repeats of one state differ by under load.
Errors are the same from run to run, and may be worse by `ERROR`.

============================= ========================================================================================
over the bare loop            `smooth`, and a walk in progress, all of it: what GTSAM is called for once a sample
over the compiled loop        `detect_stances`, `run_iez`, the filters with a compass: compiled, they are held against a
                              compiled loop that turns and accelerates by each sample, and does nothing else
doubling                      cost of `smooth` over that on half the walk
field                         the smoother with the magnetometer over without
rmse                          of smoother and filter over the ground, on the same walk; and on 28 Vicon trials if these
                              are at hand and it is not `--quick`
============================= ========================================================================================
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import date
from functools import partial
from pathlib import Path
from typing import Any, Literal

import harness
import numpy as np
import walks
from benchmark import BARE, DETECT, IEZ, SMOOTH, compile_all, measure_calls, run_bare_loop
from harness import measure_time
from walks import simulate_long_walk

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.ekf import run_iez
from fg_nav.ekf.presets import TUNED, run_filter
from fg_nav.errors import FgNavError, OutputError
from fg_nav.evaluation import evaluate
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.online.buffer import OnlineOptions, rows_of
from fg_nav.online.navigator import OnlineNavigator
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.smoother import smooth
from fg_nav.system.compiled import njit
from fg_nav.walk import Options, Walk

BASELINE = Path(__file__).resolve().parents[1] / "docs" / "results" / "benchmark.json"

SPEED, ERROR = 0.25, 0.03  # Tolerances.

SEED = 1
QUICK_MINUTES, MINUTES, BLOCK = 2.0, 20.0, 64
COMPASS = ("ma2018", "aiez")
COMPILED, LOOPS = "compiled loop", 10


@dataclass(frozen=True)
class Metric:
    """A figure with what may become of it; `tolerance` is a share of the baseline."""

    name: str
    unit: str
    value: float
    better: Literal["lower", "higher"] = "lower"
    tolerance: float = SPEED

    def worse_by(self, baseline: float) -> float:
        """By what share of the baseline it is worse; negative where it is better."""
        change = self.value / baseline - 1.0
        return change if self.better == "lower" else -change


def measure_metrics(quick: bool, repeats: int, data: Path | None) -> list[Metric]:
    """Measure all metrics, or those that take a minute."""
    compile_all()
    minutes = QUICK_MINUTES if quick else MINUTES
    recording = simulate_long_walk(minutes, SEED, field="indoor")
    inertial = replace(recording, mag=None)
    found = [*_measure_estimators(inertial, minutes, repeats), *_measure_field(recording, minutes, repeats)]
    found += _measure_errors({f"{minutes:g} min": (inertial, None)})
    return found if quick else found + _measure_real(data)


def _measure_estimators(recording: Recording, minutes: float, repeats: int) -> list[Metric]:
    """What estimators cost over the bare loop, and a walk over half of it."""
    half = recording.slice(0, len(recording) // 2)
    whole, part = [], []
    for _ in range(repeats):
        times = {name: time.cpu for name, time in measure_calls(recording).items()}
        whole.append({**times, COMPILED: time_compiled_loop(recording)})
        part.append(measure_time(partial(smooth, half, detect_stances(half)))[0].cpu)
    names = {SMOOTH: ("smooth", BARE), DETECT: ("detect_stances", COMPILED), IEZ: ("run_iez", COMPILED)}
    metrics = [_divide(words, whole, name, by, minutes) for name, (words, by) in names.items()]
    doubling = _median([r[SMOOTH] / h for r, h in zip(whole, part, strict=True)])
    return [*metrics, Metric(f"smooth, {minutes:g} min over half of it", "ratio", doubling)]


def _measure_field(recording: Recording, minutes: float, repeats: int) -> list[Metric]:
    """What the magnetometer costs the smoother, the filters with a compass, and a walk in progress."""
    walk = prepare_walk(Walk.of(recording, Options()))
    inertial = prepare_walk(Walk.of(recording, Options(use_magnetometer=False)))
    calls: dict[str, Callable[[], object]] = {
        BARE: partial(run_bare_loop, recording),
        "with": partial(run_method, walk, "smoother"),
        "without": partial(run_method, inertial, "smoother"),
        "online": partial(push_walk, recording),
        **{name: partial(run_filter, name, TUNED, recording, walk.stances, walk.field, None) for name in COMPASS},
    }
    for call in calls.values():
        call()
    times = []
    for _ in range(repeats):
        taken = {name: measure_time(call)[0].cpu for name, call in calls.items()}
        times.append({**taken, COMPILED: time_compiled_loop(recording)})
    ratio = _median([time["with"] / time["without"] for time in times])
    return [
        Metric(f"smoother with the field over without, {minutes:g} min", "ratio", ratio),
        _divide("online", times, "online", BARE, minutes),
        *(_divide(name, times, name, COMPILED, minutes) for name in COMPASS),
    ]


def _divide(words: str, times: Sequence[Mapping[str, float]], name: str, by: str, minutes: float) -> Metric:
    """What a call costs over a loop, the median over the repeats."""
    return Metric(f"{words} over the {by}, {minutes:g} min", "ratio", _median([one[name] / one[by] for one in times]))


def time_compiled_loop(recording: Recording) -> float:
    """Processor time of the compiled loop, s, of some in a row: one is too short to be timed."""
    period_s = np.diff(recording.t, append=recording.t[-1])
    turn_by_samples(recording.acc[:2], recording.gyr[:2], period_s[:2])

    def run_loops() -> None:
        for _ in range(LOOPS):
            turn_by_samples(recording.acc, recording.gyr, period_s)

    return measure_time(run_loops)[0].cpu / LOOPS


@njit(cache=True)
def turn_by_samples(acc: Floats, gyr: Floats, period_s: Floats) -> Floats:
    """Quaternion (w, x, y, z), and velocity (3,) behind it, that samples (N, 3) lead to from a rest that is level."""
    w, x, y, z = 1.0, 0.0, 0.0, 0.0
    u, v, s = 0.0, 0.0, 0.0
    for i in range(len(acc)):
        h = period_s[i]
        a, b, c = acc[i, 0], acc[i, 1], acc[i, 2]
        # q a q*, by two cross products: a + 2 w (r x a) + 2 r x (r x a), r the vector of q.
        d, e, f = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        u += h * (a + w * d + y * f - z * e)
        v += h * (b + w * e + z * d - x * f)
        s += h * (c + w * f + x * e - y * d - GRAVITY_M_S2)
        # q * exp(w h / 2)
        p, q, r = 0.5 * h * gyr[i, 0], 0.5 * h * gyr[i, 1], 0.5 * h * gyr[i, 2]
        angle = np.sqrt(p * p + q * q + r * r)
        share = np.sin(angle) / angle if angle > 0.0 else 1.0
        o, p, q, r = np.cos(angle), share * p, share * q, share * r
        w, x, y, z = (
            w * o - x * p - y * q - z * r,
            w * p + x * o + y * r - z * q,
            w * q - x * r + y * o + z * p,
            w * r + x * q - y * p + z * o,
        )
    return np.array([w, x, y, z, u, v, s])


def push_walk(recording: Recording) -> None:
    """Follow a recording as if it were being walked, solved again in this process."""
    navigator, rows = OnlineNavigator(OnlineOptions(heading_rad=None)), rows_of(recording)
    for start in range(0, len(rows), BLOCK):
        navigator.add_rows(rows[start : start + BLOCK])
    navigator.close()


def _measure_errors(some: Mapping[str, tuple[Recording, Any]]) -> list[Metric]:
    """Mean rmse over the ground of smoother and filter."""
    metrics = []
    for words, method in (("smooth", smooth), ("run_iez", run_iez)):
        errors = []
        for recording, stances in some.values():
            solution = method(recording, stances or detect_stances(recording))
            errors.append(evaluate(solution, recording.truth).rmse_2d_m or np.inf)
        of = next(iter(some)) if len(some) == 1 else f"mean of {len(some)} Vicon trials"
        metrics.append(Metric(f"rmse of {words}, {of}", "m", float(np.mean(errors)), tolerance=ERROR))
    return metrics


def _measure_real(data: Path | None) -> list[Metric]:
    try:
        trials = [one.read_labelled() for one in walks.list_set(walks.data_folder(data), "vicon")]
    except FgNavError as error:
        print(f"without the real walks: {error}")
        return []
    return _measure_errors({walk.name: (walk.recording, walk.stances) for walk in trials})


def _median(values: Sequence[float] | Floats) -> float:
    return float(np.median(values))


# --- the baseline ----------------------------------------------------------------------------------------------------


def save_metrics(metrics: Sequence[Metric], path: Path) -> None:
    """Write metrics into the baseline; those that were not measured, and all else in it, stay."""
    content = _read(path)
    kept = {one["name"]: one for one in content.get("metrics", [])}
    kept |= {metric.name: asdict(replace(metric, value=float(f"{metric.value:.4g}"))) for metric in metrics}
    harness.write_json(path, {**content, "metrics": list(kept.values())})


def save_peers(rows: Sequence[Mapping[str, object]], path: Path) -> None:
    """Write the rows of other programs next to the metrics."""
    harness.write_json(path, {**_read(path), "measured": f"{date.today()}", "peers": list(rows)})


def read_baseline(path: Path) -> dict[str, float]:
    """Return values by name; raises `OutputError` where there is no baseline."""
    known = {str(one["name"]): float(one["value"]) for one in _read(path).get("metrics", [])}
    if not known:
        raise OutputError(f"there is no baseline {path}: write one with --save.")
    return known


def _read(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else {}


def compare_baseline(metrics: Sequence[Metric], baseline: Mapping[str, float]) -> list[Metric]:
    """Print each metric next to the baseline; return those that are worse than their tolerance, or are no number."""
    rows, worse = [], []
    for metric in metrics:
        before = baseline.get(metric.name)
        by = np.nan if before is None else metric.worse_by(before)
        is_worse = not np.isfinite(metric.value) or by > metric.tolerance
        worse += [metric] if is_worse else []
        mark = "missed" if is_worse else "new" if before is None else "ok"
        shown = ["-" if value is None else f"{value:.4g}" for value in (metric.value, before)]
        change = "-" if before is None else f"{100 * (metric.value / before - 1):+.0f} %"
        rows.append([metric.name, metric.unit, metric.better, *shown, change, f"{100 * metric.tolerance:.0f} %", mark])
    harness.print_table(("metric", "unit", "better", "now", "baseline", "change", "tolerance", ""), rows)
    return worse
