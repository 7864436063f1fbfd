"""What is read off the figures of Munoz Diaz et al. (2017), and how it is read off our runs.

One `Row` a figure; of `reproduce_munoz_diaz2017.py`. Biases are in deg/s, axis z along the thigh.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from munoz_diaz2017_figures import Run, Setting

from fg_nav.pocket.paper import PUBLISHED

SECOND_NOISES_UT = (0.05, 0.015, 0.106)
"""White errors of the MTw's magnetometer, uT, as its filters are told: the preset's, which lies between Table 2's and
that of its sheet as we remember it; then these two."""


@dataclass(frozen=True)
class Row:
    """One figure of the paper: `measure` reads ours off a run.

    Asked are `band` of the filter done right, and no more than `graph` of the graph.
    """

    section: str
    words: str
    case: str
    paper: str
    measure: Callable[[Run, Setting], float]
    pattern: str = "{:.1f}"
    band: tuple[float, float] = (-math.inf, math.inf)
    graph: float = math.inf


def reached(axis: int, level: float) -> Callable[[Run, Setting], float]:
    """Minute at which a bias first is as far from zero as `level`, deg/s, to the same side; infinite for never."""

    def measure(run: Run, _: Setting) -> float:
        there = np.flatnonzero(run.bias[:, axis] * np.sign(level) >= abs(level))
        return float(run.minute[there[0]]) if len(there) else math.inf

    return measure


def at_end(axis: int) -> Callable[[Run, Setting], float]:
    """Bias of the last minute, deg/s."""
    return lambda run, _: float(run.bias[run.minute > run.minute[-1] - 1.0, axis].mean())


def at_minute(axis: int, minute: float) -> Callable[[Run, Setting], float]:
    """Bias at a minute, deg/s."""
    return lambda run, _: float(np.interp(minute, run.minute, run.bias[:, axis]))


def largest(axis: int, from_min: float = 0.0) -> Callable[[Run, Setting], float]:
    """How far a bias is from the true one at most, deg/s; which way goes by the iron."""

    def measure(run: Run, setting: Setting) -> float:
        return float(np.abs(run.bias - setting.bias)[run.minute >= from_min, axis].max(initial=0.0))

    return measure


def share_used(run: Run, _: Setting) -> float:
    """Share of the seconds in which the field was used."""
    return float(run.used.mean())


def jump(event: int) -> Callable[[Run, Setting], float]:
    """How far the z bias goes to and fro while one passes, deg/s: within 0.3 min of it."""

    def measure(run: Run, setting: Setting) -> float:
        near = np.abs(run.minute - setting.passed_min[event]) < 0.3
        return float(np.ptp(run.bias[near, 2])) if near.any() else math.nan

    return measure


def yaw_at_end(run: Run, _: Setting) -> float:
    """Yaw error, deg, without its sign."""
    return float(abs(run.yaw_error[-1]))


def yaw_range(begin: float, end: float) -> Callable[[Run, Setting], float]:
    """How far the yaw error goes to and fro between two minutes, deg."""

    def measure(run: Run, _: Setting) -> float:
        part = (run.minute >= begin) & (run.minute <= end)
        return float(np.ptp(run.yaw_error[part])) if part.any() else math.nan

    return measure


def yaw_after(legs: int) -> Callable[[Run, Setting], float]:
    """Yaw error after so many ways along the street, deg, without its sign."""

    def measure(run: Run, setting: Setting) -> float:
        end = setting.ends[setting.legs < legs][-1] / 60.0
        return float(abs(np.interp(end, run.minute, run.yaw_error)))

    return measure


def away_after(legs: int) -> Callable[[Run, Setting], float]:
    """Distance from the first place to that after so many ways along the street, m; truly none."""
    return lambda run, setting: float(np.linalg.norm(run.path[np.flatnonzero(setting.legs < legs)[-1]]))


def within(minutes: float) -> tuple[float, float]:
    """The 40 % to either side that are asked for."""
    return 0.6 * minutes, 1.4 * minutes


_X, _Y, _Z = range(3)
_BIAS = "{:.3f}"
MINUTES = "min until z is at -0.08 deg/s"

ROWS = (
    Row("Figure 8: gravity only", "min until y is at 0.08 deg/s", "gravity", "converges", reached(_Y, 0.08), "{:.2f}"),
    Row("Figure 8: gravity only", "x at the end (true -0.1)", "gravity", "not reached", at_end(_X), _BIAS),
    Row("Figure 8: gravity only", "z at the end (true -0.1)", "gravity", "not found", at_end(_Z), _BIAS, (-0.05, 0.05)),
    *(
        Row(f"Figure 9{panel}: {field}", MINUTES, field, f"{minutes:.0f}", reached(_Z, -0.08), band=within(minutes))
        for panel, field, minutes in (
            ("a", "north-pole", PUBLISHED.minutes_north_pole),
            ("b", "equator", PUBLISHED.minutes_equator),
            ("c", "munich", PUBLISHED.minutes_munich),
        )
    ),
    *(
        Row(f"Figure 9{panel}: {field}", "z at the end (true -0.1)", field, "near it", at_end(_Z), _BIAS)
        for panel, field in (("a", "north-pole"), ("b", "equator"), ("c", "munich"))
    ),
    *(
        Row("3.1.2: track turned", f"min until {words}, {case}", case, said, measure)
        for words, measure, sayings in (
            ("y is at 0.08", reached(_Y, 0.08), ("-", "slightly sooner")),
            ("z is at -0.08", reached(_Z, -0.08), ("-", "as before")),
        )
        for field in ("equator", "munich")
        for case, said in zip((field, f"{field}, north-south"), sayings, strict=True)
    ),
    Row("Figure 10: perturbed", "always: z off at most, after 15 min", "cars", "-", largest(_Z, 15), _BIAS),
    Row("Figure 10: perturbed", f"always: {MINUTES}", "cars", "tends to it", reached(_Z, -0.08)),
    *(
        Row("Figure 10: perturbed", f"{words}: jump of z at {what}, deg/s", case, said, jump(event), _BIAS)
        for words, case, sayings in (
            ("always", "cars", ("strong", "strong", "-", "strong")),
            ("detector", "cars, detector", ("smoother", "smoother", "smoother", "smoother")),
        )
        for event, (what, said) in enumerate(
            zip(("16 min (car)", "24 min (lamp)", "32 min (car)", "35 min (lamp)"), sayings, strict=True)
        )
    ),
    Row(
        "Figure 10: perturbed",
        f"detector: {MINUTES}",
        "cars, detector",
        "32",
        reached(_Z, -0.08),
        band=within(PUBLISHED.minutes_perturbed),
    ),
    Row(
        "Figure 10: perturbed",
        "detector: z at 32 min (true -0.1)",
        "cars, detector",
        "near it",
        at_minute(_Z, 32),
        _BIAS,
    ),
    Row(
        "Figure 10: perturbed",
        f"detector, Eq. 21 as printed: {MINUTES}",
        "cars of Eq. 21 as printed, detector",
        "-",
        reached(_Z, -0.08),
        band=within(PUBLISHED.minutes_perturbed),
    ),
    *(
        Row("Figure 10: perturbed", f"{words}: share of time with the update", case, "-", share_used, "{:.2f}")
        for words, case in (
            ("detector", "cars, detector"),
            ("detector, Eq. 21 as printed", "cars of Eq. 21 as printed, detector"),
        )
    ),
    Row("Figure 11a: gravity only", "yaw error at the end, deg", "gravity", "grows steadily", yaw_at_end, "{:.0f}"),
    Row(
        "Figure 11b: Munich", "yaw goes to and fro by, 0 to 15 min", "munich", "not stable", yaw_range(0, 15), "{:.0f}"
    ),
    Row("Figure 11b: Munich", "... and from then on", "munich", "-", yaw_range(15, 60), "{:.0f}"),
    Row("Figure 11b: Munich", "yaw error at the end, deg", "munich", "-", yaw_at_end, "{:.1f}", graph=3.0),
    Row("Figure 11c: Equator", "yaw goes to and fro by, 0 to 10 min", "equator", "-", yaw_range(0, 10), "{:.0f}"),
    Row("Figure 11c: Equator", "... and from then on", "equator", "stable", yaw_range(10, 60), "{:.0f}"),
    Row("Figure 11c: Equator", "yaw error at the end, deg", "equator", "-", yaw_at_end, "{:.1f}", graph=3.0),
    Row(
        "Figure 11d: perturbed",
        "yaw error at the end, deg",
        "cars, detector",
        "to and fro",
        yaw_at_end,
        "{:.1f}",
        graph=6.0,
    ),
    Row("Figure 13a: MTw, gravity", "x at the end (true -0.13)", "MTw, gravity", "-0.13", at_end(_X), _BIAS),
    Row("Figure 13a: MTw, gravity", "y at the end (true 0.05)", "MTw, gravity", "0.05", at_end(_Y), _BIAS),
    Row("Figure 13a: MTw, gravity", "z at the end (true -0.22)", "MTw, gravity", "not found", at_end(_Z), _BIAS),
    Row(
        "Figure 13b: uncalibrated",
        "z off at most, after 3 min",
        "MTw, raw",
        "1.5",
        largest(_Z, 3),
        _BIAS,
    ),
    Row(
        "Figure 13b: uncalibrated",
        "x off at most, after 3 min",
        "MTw, raw",
        "about 0.4",
        largest(_X, 3),
        _BIAS,
    ),
    *(
        Row(
            "Figure 13b: uncalibrated",
            f"z off at most, noise {noise} uT",
            f"MTw, raw, {noise}",
            "-",
            largest(_Z, 3),
            _BIAS,
        )
        for noise in SECOND_NOISES_UT[1:]
    ),
    Row("Figure 13c: calibrated", "z at the end (true -0.22)", "MTw, calibrated", "not reached", at_end(_Z), _BIAS),
    *(
        Row(
            "Figure 13c: calibrated",
            f"z at the end, noise {noise} uT",
            f"MTw, calibrated, {noise}",
            "-",
            at_end(_Z),
            _BIAS,
        )
        for noise in SECOND_NOISES_UT[1:]
    ),
    *(
        Row(f"Figure 14: {words}", what, case, said, measure, "{:.0f}")
        for words, case, sayings in (
            ("both updates", "MTw, calibrated", ("20", "30", "160")),
            ("gravity only", "MTw, gravity", ("50", "140", "270")),
        )
        for what, said, measure in (
            ("yaw error after the first round trip, deg", sayings[0], yaw_after(2)),
            ("displacement after it, m", sayings[1], away_after(2)),
            ("yaw error at the end, deg", sayings[2], yaw_at_end),
            ("displacement at the end, m", "-", away_after(12)),
        )
    ),
)
