"""The figures of Munoz Diaz et al. (2017), experiment by experiment: as printed, how ours is read, why it differs.

Some results are printed in words only, "not found" or "smoother". They are held to what the words say at least: that a
bias is farther from the true one than half of it, that a jump is smaller than the other. Those rows give their bound in
brackets. What was asked of the graph, which the paper does not have, is a row of its own, judged by the online one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fg_nav.lab.reproduce.munoz_diaz2017 import text
from fg_nav.lab.reproduce.munoz_diaz2017.runs import (
    Measure,
    X,
    Y,
    Z,
    at_end,
    at_minute,
    away_after,
    for_good,
    from_zero,
    jump,
    largest,
    over,
    reached,
    share_used,
    yaw_after,
    yaw_at_end,
    yaw_grown,
    yaw_range,
    yaw_wander,
)
from fg_nav.lab.reproduce.munoz_diaz2017.walks import ALL, BATCH, FILTER, ONLINE, PUBLISHED, SECOND_NOISES_UT
from fg_nav.lab.reproduce.results import TOLERANCE, Row

OURS, EXPECTED = "ours", "by the field"  # Columns of what no estimator has a hand in.

AT_MOST, AT_LEAST = 1, -1

NEAR_ONE = 0.15  # Of a ratio that the paper has at one: without an effect it is one as well.
NEAR_BIAS = 0.2  # Of a bias that the paper finds.
COMES_BACK = 1.5  # Up and down over what is got by it: half as much back as forth.


@dataclass(frozen=True)
class Reading:
    """A row without our figures, and how they are come by.

    Attributes
    ----------
    row : the row, `ours` empty.
    case, measure : read off the runs of this case; "" where it is no run's (`seed`).
    over_case : the figure is taken over the same one of this case.
    without : estimators that it says nothing of: one that is given the whole walk takes no time.
    """

    row: Row
    case: str = ""
    measure: Measure | None = None
    over_case: str = ""
    without: tuple[str, ...] = ()


@dataclass(frozen=True)
class Planned:
    """An experiment: name in the list of the papers' experiments, columns, readings, and the paper's figures drawn."""

    name: str
    columns: Sequence[str]
    readings: Sequence[Reading]
    figures: Sequence[str] = ()


def _run(
    quantity: str,
    unit: str,
    printed: str,
    case: str,
    measure: Measure,
    over_case: str = "",
    without: tuple[str, ...] = (),
    **more: Any,
) -> Reading:
    row = Row(quantity, unit, printed, {}, **{"judged": FILTER, "good": 0, "pattern": "{:.1f}", **more})
    return Reading(row, case, measure, over_case, without)


def _minutes(quantity: str, printed: str, case: str, measure: Measure, **more: Any) -> Reading:
    """How long something takes."""
    return _run(quantity, "min", printed, case, measure, without=(BATCH,), **more)


def _own(quantity: str, unit: str, printed: str, paper: float | None, pattern: str, **more: Any) -> Reading:
    return Reading(Row(quantity, unit, printed, {}, paper, **{"judged": OURS, "good": 0, "pattern": pattern, **more}))


_BIAS = "{:.3f}"
AXES = "xyz"


def _errors(words: str, printed: Sequence[float]) -> list[Reading]:
    """Three rows of Tables 2 and 3, an axis each."""
    return [
        _own(f"{words}, {axis}", "deg/s", f"{value:.2f}", value, _BIAS, whose="input")
        for axis, value in zip(AXES, printed, strict=True)
    ]


WHITE, FIRST_BIAS = "white error of a sample", "bias, first walk"
SECOND_START, SECOND_END = "bias, second walk, start", "bias, second walk, end"
FOG = {
    "compensated": "largest angle in an hour at rest, the Earth's rate taken off",
    "not compensated": "largest angle in an hour at rest, the Earth's rate left in",
}
AT_A_SECOND, LOWEST = "white noise at 1 s, MTw over FOG", "lowest point B, MTw over FOG"
MIN_AT = "averaging time of it, FOG over MTw"


def minutes_over(site: str) -> str:
    """Name of a row of ratios."""
    return f"minutes over those at the equator, {site}"


_AFTER = {
    "north-pole": PUBLISHED.minutes_north_pole,
    "equator": PUBLISHED.minutes_equator,
    "munich": PUBLISHED.minutes_munich,
}

_REST = (
    _own(FOG["compensated"], "deg", "<= 1", 1.0, "{:.2f}", bound=AT_MOST, why=text.ONE_FOG, side=1),
    _own(FOG["not compensated"], "deg", "", None, "{:.1f}"),
    _own(AT_A_SECOND, "orders", "two orders", 2.0, "{:.1f}", tolerance=0.25),
    _own(LOWEST, "orders", "two orders", 2.0, "{:.1f}", tolerance=0.25, why=text.DRIFTS, side=1),
    _own(MIN_AT, "orders", "one order", 1.0, "{:.1f}", tolerance=0.5, why=text.DRIFTS, side=1),
    *_errors(WHITE, (PUBLISHED.gyr_noise_deg_s,) * 3),
    *_errors(FIRST_BIAS, PUBLISHED.gyro_bias_deg_s),
    *_errors(SECOND_START, PUBLISHED.mtw_bias_start_deg_s),
    *_errors(SECOND_END, PUBLISHED.mtw_bias_end_deg_s),
)

_GRAVITY = (
    _minutes("y is at 0.08 deg/s for good after", "converges (< 39)", "gravity", for_good(Y, 0.08),
             paper=PUBLISHED.minutes_walked, bound=AT_MOST, pattern="{:.2f}"),
    _run("x at the end, truly -0.1", "deg/s", "the right way (< 0)", "gravity", at_end(X), paper=0.0, bound=AT_MOST,
         pattern=_BIAS),
    _run("the same", "deg/s", "not reached (> -0.1)", "gravity", at_end(X), paper=-0.1, bound=AT_LEAST, pattern=_BIAS),
    _minutes("x is at -0.08 deg/s for good after", "", "gravity", for_good(X, -0.08), pattern="{:.2f}"),
    _run("z off zero at the end, truly 0.1", "deg/s", "not found (< 0.05)", "gravity", from_zero(Z), paper=0.05,
         bound=AT_MOST, pattern=_BIAS),
)  # fmt: skip


def across_at(site: str) -> str:
    """Name of a row of what shows the bias along the thigh."""
    return f"field across the thigh, root mean square, {site}"


_PLACES = (
    *(
        _minutes(f"z is at -0.08 deg/s after, {site}", f"{minutes:.0f}", site, reached(Z, -0.08), paper=minutes,
                 why=text.PRIOR, whose="input")
        for site, minutes in _AFTER.items()
    ),
    *(
        _run(f"z at the end, {site}, truly -0.1", "deg/s", "near it", site, at_end(Z), paper=-0.1, tolerance=NEAR_BIAS,
             pattern=_BIAS)
        for site in _AFTER
    ),
    *(
        _run(minutes_over(site), "", f"{minutes / PUBLISHED.minutes_equator:.2f}", site, reached(Z, -0.08), "equator",
             (BATCH,), paper=minutes / PUBLISHED.minutes_equator, pattern="{:.2f}",
             tolerance=TOLERANCE * (1 - PUBLISHED.minutes_equator / minutes),
             why=text.SWING if site == "north-pole" else text.TABLE_1, side=-1)
        for site, minutes in _AFTER.items() if site != "equator"
    ),
    *(
        Reading(Row(across_at(site), "uT", "", {}, judged=EXPECTED, good=0, pattern="{:.1f}")) for site in _AFTER
    ),
)  # fmt: skip

_TURNED = tuple(
    _run(f"{axis} is at {level} deg/s after, north-south over east-west, {site}", "", said,
         f"{site}, north-south", reached(number, level), site, (BATCH,),
         paper=1.0, pattern="{:.2f}", **more)
    for site in ("equator", "munich")
    for axis, number, level, said, more in (
        ("y", Y, 0.08, "slightly sooner (< 1)", {"bound": AT_MOST}),
        ("z", Z, -0.08, "as before (1)", {"tolerance": NEAR_ONE}),
    )
)  # fmt: skip

_EVENTS = ("16 min (car)", "24 min (lamp)", "32 min (car)", "35 min (lamp)")

_CARS = (
    _minutes("always: z is at -0.08 deg/s after", "tends to it (< 39)", "cars", reached(Z, -0.08),
             paper=PUBLISHED.minutes_walked, bound=AT_MOST),
    _run("always: z at the end, truly -0.1", "deg/s", "", "cars", at_end(Z), pattern=_BIAS),
    _run("always: z off at most, after 15 min", "deg/s", "", "cars", largest(Z, 15), pattern=_BIAS),
    *(
        _run(f"always: jump of z at {what}", "deg/s", said, "cars", jump(event), pattern=_BIAS)
        for event, (what, said) in enumerate(zip(_EVENTS, ("strong", "strong", "", "strong"), strict=True))
    ),
    *(
        _run(f"detector over always: jump of z at {what}", "", "smoother (< 1)", "cars, detector", jump(event), "cars",
             paper=1.0, bound=AT_MOST, pattern="{:.2f}")
        for event, what in enumerate(_EVENTS)
    ),
    _minutes("detector: z is at -0.08 deg/s after", "32", "cars, detector", reached(Z, -0.08),
             paper=PUBLISHED.minutes_perturbed, why=text.DETECTOR, side=-1, whose="input"),
    _run("detector: z at 32 min, truly -0.1", "deg/s", "near it", "cars, detector", at_minute(Z, 32), paper=-0.1,
         tolerance=NEAR_BIAS, pattern=_BIAS),
    _minutes("detector, MD (21) as printed: z is at -0.08 deg/s after", "32", "cars of MD (21) as printed, detector",
             reached(Z, -0.08), paper=PUBLISHED.minutes_perturbed, whose="input"),
    _run("detector: share of time with the update", "", "", "cars, detector", share_used, pattern="{:.2f}"),
    _run("detector, MD (21) as printed: the same", "", "", "cars of MD (21) as printed, detector", share_used,
         pattern="{:.2f}"),
)  # fmt: skip


def _asked(where: str, case: str, most_deg: float) -> Reading:
    """What was asked of the graph."""
    return _run(f"yaw error at the end, {where}; asked of the graph", "deg", f"asked: <= {most_deg:.0f}", case,
                yaw_at_end, paper=most_deg, bound=AT_MOST, judged=ONLINE, pattern="{:.2f}", whose="asked")  # fmt: skip


_YAW = (
    _run("yaw error at the end, gravity only", "deg", "", "gravity", yaw_at_end, pattern="{:.0f}"),
    _run("growth of it, second half over first", "", "constantly increasing (1)", "gravity",
         over(yaw_grown(0.5, 1.0), yaw_grown(0.0, 0.5)), paper=1.0, pattern="{:.2f}", tolerance=NEAR_ONE,
         why=text.SLOWER, side=-1),
    _run("yaw error up and down over how far it gets, Munich, first 15 min", "",
         f"rapidly increasing and decreasing (> {COMES_BACK})", "munich", yaw_wander(0, 15), paper=COMES_BACK,
         bound=AT_LEAST, pattern="{:.2f}", why=text.ONE_WAY, side=-1),
    _run("range of it, Munich, first 15 min", "deg", "", "munich", yaw_range(0, 15), pattern="{:.0f}"),
    _run("the same from then on over that, Munich", "", "not stable before (< 1)", "munich",
         over(yaw_range(15, 60), yaw_range(0, 15)), paper=1.0, bound=AT_MOST, pattern="{:.2f}"),
    _run("range of it, Equator, first 10 min", "deg", "", "equator", yaw_range(0, 10), pattern="{:.0f}"),
    _run("the same from then on over that, Equator", "", "stable then (< 1)", "equator",
         over(yaw_range(10, 60), yaw_range(0, 10)), paper=1.0, bound=AT_MOST, pattern="{:.2f}"),
    _run("range of it, cars and detector, after 15 min", "deg", "seen in it", "cars, detector",
         yaw_range(15, 60), pattern="{:.0f}"),
    _asked("Munich", "munich", 3.0),
    _asked("Equator", "equator", 3.0),
    _asked("cars", "cars, detector", 6.0),
)  # fmt: skip

_MTW = (
    _run("gravity: x at the end, truly -0.13", "deg/s", "-0.13", "MTw, gravity", at_end(X), paper=-0.13,
         tolerance=NEAR_BIAS, pattern=_BIAS),
    _run("gravity: y at the end, truly 0.05", "deg/s", "0.05", "MTw, gravity", at_end(Y), paper=0.05,
         tolerance=NEAR_BIAS, pattern=_BIAS),
    _run("gravity: z off zero at the end, truly 0.22", "deg/s", "not found (< 0.11)", "MTw, gravity", from_zero(Z),
         paper=0.11, bound=AT_MOST, pattern=_BIAS),
    _run("uncalibrated: z off at most, after 3 min", "deg/s", "1.5 (at -1.7)", "MTw, raw", largest(Z, 3), paper=1.5,
         why=text.IRON, whose="input", pattern=_BIAS),
    _run("uncalibrated: x off at most, after 3 min", "deg/s", "about 0.4 (at -0.5)", "MTw, raw", largest(X, 3),
         paper=0.4, why=text.IRON, whose="input", pattern=_BIAS),
    _run("calibrated: z at the end, truly -0.22", "deg/s", "not reached (> -0.22)", "MTw, calibrated", at_end(Z),
         paper=-0.22, bound=AT_LEAST, pattern=_BIAS),
    *(
        _run(f"{words}, noise of the magnetometer {noise} uT", "deg/s", "", f"MTw, {state}, {noise}", measure,
             pattern=_BIAS)
        for noise in SECOND_NOISES_UT[1:]
        for words, state, measure in (
            ("uncalibrated: z off at most", "raw", largest(Z, 3)),
            ("calibrated: z at the end", "calibrated", at_end(Z)),
        )
    ),
)  # fmt: skip

_BOTH, _ALONE = "MTw, calibrated", "MTw, gravity"

_WAY = (
    *(
        _run(f"{words}: {what}", unit, said, case, measure, paper=float(said) if said else None, good=-1,
             pattern="{:.0f}", why=why, side=1, whose=whose)
        for words, case, whose, sayings, whys in (
            ("both updates", _BOTH, "paper", ("20", "30", "160"), (text.TRIP, text.FOLLOWS, "")),
            ("gravity only", _ALONE, "input", ("50", "140", "270"), ("", "", "")),
        )
        for what, unit, said, measure, why in (
            ("yaw error after the first round trip", "deg", sayings[0], yaw_after(2), whys[0]),
            ("displacement after it", "m", sayings[1], away_after(2), whys[1]),
            ("yaw error at the end", "deg", sayings[2], yaw_at_end, whys[2]),
            ("displacement at the end", "m", "", away_after(12), ""),
        )
    ),
    *(
        _run(f"both updates over gravity only: yaw error {when}", "", f"{one / other:.2f}", _BOTH, measure, _ALONE,
             paper=one / other, good=-1, pattern="{:.2f}", why=text.RATIO, side=1)
        for when, one, other, measure in (
            ("after the first round trip", 20, 50, yaw_after(2)), ("at the end", 160, 270, yaw_at_end),
        )
    ),
)  # fmt: skip

PLAN = (
    Planned("D-E0", (OURS,), _REST, ("figure-05",)),
    Planned("D-E1", ALL, _GRAVITY, ("figure-08",)),
    Planned("D-E2", (*ALL, EXPECTED), _PLACES, ("figure-09",)),
    Planned("D-E2d", ALL, _TURNED),
    Planned("D-E3", ALL, _CARS, ("figure-04", "figure-07", "figure-10")),
    Planned("D-E4", ALL, _YAW, ("figure-11",)),
    Planned("D-E5", ALL, _MTW, ("figure-13",)),
    Planned("D-E6", ALL, _WAY, ("figure-14",)),
)
"""All experiments."""
