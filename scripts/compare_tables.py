"""Results of methods in tables, the papers' figures below ours, and what was asked of them.

Figures are medians over the walks (5 % to 95 %), of their size where they have a sign; a reduction is that of one walk,
and keeps its sign. A method that fails on a walk is infinitely wrong there; one that fails on all has no figures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import harness
import numpy as np
from harness import Figure

from fg_nav.arrays import Floats
from fg_nav.evaluation.walked import AS_STARTED, BEST_YAW, CLOSURE, error_reduction_percent
from fg_nav.lab.campaign.methods import method_of
from fg_nav.lab.campaign.walks import WALK
from fg_nav.lab.reproduce.walks import at_landmarks, mean, used_percent, walk_error
from fg_nav.lab.store.code import code_sum
from fg_nav.lab.store.results import Result
from fg_nav.report.terminal import console
from fg_nav.wording import counted

OFFICE, OFFICE_OPEN, MALL, BUILDING = "office", "office-open", "mall", "teaching-building"

REFERENCE = {MALL: "iqsf"}
"""Method whose errors the others reduce, as in the paper; elsewhere the first of these."""

OTHER_REFERENCE = "iez"


@dataclass(frozen=True)
class Paper:
    """What a paper prints of a method, by the names of the columns."""

    words: str
    printed: Mapping[str, str]


PAPERS: Mapping[tuple[str, str], Paper] = {
    (OFFICE, "iez"): Paper("Ma 2018, pure ZUPT", {"end": "2", "heading": "14"}),
    (OFFICE, "iqsf"): Paper("Ma 2018, iQSF", {"end": "<= 0.5"}),
    (OFFICE, "ma2018"): Paper("Ma 2018, proposed", {"end": "<= 0.5"}),
    (MALL, "iqsf"): Paper("Ma 2018, iQSF", {"at landmarks, mean": "11.3", "max": "51"}),
    (MALL, "ma2018"): Paper(
        "Ma 2018, proposed", {"at landmarks, mean": "1.5", "max": "3", "at landmarks, reduction": "85"}
    ),
    (BUILDING, "iez"): Paper("Zhang 2017, IEZ", {"end": "9.49", "TTD": "1.84"}),
    (BUILDING, "qsf-stance"): Paper("Zhang 2017, + classical QMD", {"end": "7.09", "TTD": "1.38"}),
    (BUILDING, "aiez"): Paper("Zhang 2017, AIEZ", {"end": "0.79", "TTD": "0.15"}),
}


@dataclass(frozen=True)
class Column:
    """A figure of a result (None where it has none), by the name that the papers' figures go by.

    `failed` is the figure of a walk on which the method failed: the worst there is, or None to leave the walk out.
    """

    head: str
    paper: str
    value: Callable[[Result, Result | None], float | None]
    failed: float | None = math.inf


Case: TypeAlias = Mapping[str, Sequence[Result]]
"""Results by method, of one group, field and magnetometer."""


def by_case(results: Sequence[Result]) -> dict[str, Case]:
    """Results of each case by method, in the order in which they come."""
    cases: dict[str, dict[str, list[Result]]] = {}
    for result in results:
        key = result.key
        name = ", ".join((key.group, key.field, f"magnetometer {key.magnetometer}"))
        cases.setdefault(name, {}).setdefault(key.method, []).append(result)
    return dict(cases)


def _figure(mode: str, name: str, result: Result, _: Result | None = None) -> float | None:
    return walk_error(result, name, mode)


def _at_landmarks(mode: str, of: Callable[[Sequence[float]], float], result: Result, _: Result | None) -> float | None:
    return at_landmarks(result, of, mode)


def _reduction(
    value: Callable[[Result, Result | None], float | None], result: Result, reference: Result | None
) -> float | None:
    if reference is None or reference is result:
        return None
    ours, theirs = value(result, None), value(reference, None)
    if ours is None or not theirs:
        return None
    return error_reduction_percent(ours, theirs)


def _ratio(
    value: Callable[[Result, Result | None], float | None], result: Result, reference: Result | None
) -> float | None:
    if reference is None or reference is result or reference.failed:
        return None
    ours, theirs = value(result, None), value(reference, None)
    return None if ours is None or not theirs else ours / theirs


def _used_percent(result: Result, _: Result | None) -> float | None:
    return used_percent(result)


STARTED_MEAN = partial(_figure, AS_STARTED, "mean_m")
STARTED_RMSE = partial(_figure, AS_STARTED, "rmse_m")
STARTED_AT_LANDMARKS = partial(_at_landmarks, AS_STARTED, mean)

END = Column("end, as started (m)", "end", partial(_figure, AS_STARTED, "end_m"))
TTD = Column("TTD (%)", "TTD", partial(_figure, AS_STARTED, "end_percent"))
HEADING = Column("heading (deg)", "heading", partial(_figure, AS_STARTED, "heading_deg"))
HEADING_LAID = Column("heading, laid (deg)", "", partial(_figure, AS_STARTED, "heading_laid_deg"))
HEADING_RMSE = Column("heading rmse (deg)", "", partial(_figure, AS_STARTED, "heading_rmse_deg"))
RMSE = Column("rmse, as started (m)", "", STARTED_RMSE)
LANDMARK_MEAN = Column("mean, as started (m)", "at landmarks, mean", STARTED_AT_LANDMARKS)
LANDMARK_MAX = Column("max, as started (m)", "", partial(_at_landmarks, AS_STARTED, max))
REDUCED = "reduction of the mean (%)"
REDUCTION = Column(REDUCED, "at landmarks, reduction", partial(_reduction, STARTED_AT_LANDMARKS), -math.inf)

TABLES: Mapping[str, Sequence[Column]] = {
    "At the end": (
        END,
        TTD,
        HEADING,
        HEADING_LAID,
        Column("height (m)", "", partial(_figure, AS_STARTED, "end_height_m")),
        Column("end, yaw (m)", "", partial(_figure, BEST_YAW, "end_m")),
        Column("TTD, yaw (%)", "", partial(_figure, BEST_YAW, "end_percent")),
        Column("closure (m)", "", partial(_figure, CLOSURE, "end_m")),
        Column("TTD, closure (%)", "", partial(_figure, CLOSURE, "end_percent")),
    ),
    "Along the walk, at the footfalls": (
        RMSE,
        HEADING_RMSE,
        Column("mean, as started (m)", "", STARTED_MEAN),
        Column("max, as started (m)", "max", partial(_figure, AS_STARTED, "max_m")),
        Column("mean, yaw (m)", "", partial(_figure, BEST_YAW, "mean_m")),
        Column("max, yaw (m)", "", partial(_figure, BEST_YAW, "max_m")),
        Column(REDUCED, "", partial(_reduction, STARTED_MEAN), -math.inf),
        Column("scale of strides (%)", "", partial(_figure, BEST_YAW, "length_percent")),
        Column("scale of path (%)", "", partial(_figure, BEST_YAW, "scale_percent")),
        Column("field used (%)", "", _used_percent, None),
    ),
    "At the landmarks": (
        LANDMARK_MEAN,
        LANDMARK_MAX,
        Column("mean, yaw (m)", "", partial(_at_landmarks, BEST_YAW, mean)),
        Column("max, yaw (m)", "", partial(_at_landmarks, BEST_YAW, max)),
        REDUCTION,
    ),
}


OPPONENTS = ("ma2018", "matched", "matched-rts", "inertial")
"""Methods whose errors stand under the others', walk by walk: the paper's, one of the same models, the same with the
way back, and the same graph without the field. What separates them is where a gain comes from."""


@dataclass(frozen=True)
class Asked:
    """What was asked of the median of a method, `low <= median <= high`, and by whom.

    Attributes
    ----------
    group, method, column : what of.
    high, low : on the field `smooth` and, unless `eased`, on all others.
    source : who asks, or whose figure it is.
    against : asked is the ratio to this method's figure, walk by walk, and that of the medians.
    eased : on `smooth` as it stands, on `indoor` within the factor `INDOOR_FACTOR`, and on no other field.
    """

    group: str
    method: str
    column: Column
    high: float = math.inf
    low: float = -math.inf
    source: str = ""
    against: str = ""
    eased: bool = False

    def upper(self, level: str) -> float:
        """`high` on a field of this level."""
        return self.high * LEVELS[level] if self.eased else self.high

    def of(self, group: str, method: str, level: str) -> bool:
        """Whether it is asked of this."""
        return (self.group, self.method) == (group, method) and (not self.eased or level in LEVELS)


SAME_ORDER = 3.0
"""Within this factor of the paper's figure a drift is of the same order, as in `simulated_drift`."""

INDOOR_FACTOR = 1.5
LEVELS: Mapping[str, float] = {"smooth": 1.0, "indoor": INDOOR_FACTOR}
"""By how much what is asked of the smoother is eased in each field."""

MA, ZHANG, OURS = "Ma 2018", "Zhang 2017", "issue 6"

_smoother = partial(Asked, method="smoother", eased=True)

ASKED = (
    Asked(OFFICE, "iez", END, 2.0 * SAME_ORDER, 2.0 / SAME_ORDER, MA),
    Asked(OFFICE, "iez", HEADING, 14.0 * SAME_ORDER, 14.0 / SAME_ORDER, MA),
    Asked(OFFICE, "iqsf", END, 0.5, source=MA),
    Asked(OFFICE, "ma2018", END, 0.5, source=MA),
    Asked(MALL, "ma2018", REDUCTION, low=85.0, source=MA),
    Asked(BUILDING, "iez", TTD, 1.84 * SAME_ORDER, 1.84 / SAME_ORDER, ZHANG),
    Asked(BUILDING, "qsf-stance", TTD, 1.38 * SAME_ORDER, 1.38 / SAME_ORDER, ZHANG),
    Asked(BUILDING, "aiez", TTD, 0.15 * SAME_ORDER, source=ZHANG),
    _smoother(MALL, column=LANDMARK_MEAN, high=0.75, source=f"{OURS}; {MA} 1.5"),
    _smoother(MALL, column=LANDMARK_MAX, high=2.0, source=f"{OURS}; {MA} 3"),
    _smoother(MALL, column=LANDMARK_MEAN, high=0.5, source=OURS, against="ma2018"),
    _smoother(MALL, column=LANDMARK_MEAN, high=0.7, source=OURS, against="matched"),
    _smoother(MALL, column=LANDMARK_MEAN, source="for information", against="matched-rts"),
    _smoother(MALL, column=HEADING_RMSE, high=1.5, source=OURS),
    _smoother(OFFICE, column=RMSE, high=0.35, source=OURS),
    _smoother(OFFICE, column=END, high=0.4, source=f"{OURS}; {MA} 0.5"),
    _smoother(OFFICE, column=HEADING_LAID, high=1.0, source=OURS),
    _smoother(OFFICE_OPEN, column=TTD, high=0.3, source=OURS),
    _smoother(BUILDING, column=TTD, high=0.10, source=f"{OURS}; {ZHANG} 0.15"),
)
"""The papers' figures, what a paper gives as drift by its order only; and what the smoother is to reach."""


def print_case(name: str, case: Case, reference: str | None = None) -> None:
    """Print the tables of a case; one that would be empty is left out, and so is a column."""
    group = next(iter(case.values()))[0].key.group
    against = reference or REFERENCE.get(group, OTHER_REFERENCE)
    count = max(len(results) for results in case.values())
    harness.print_heading(f"{name}: {counted(count, 'walk')}, median (5 % to 95 %)")
    first = next(iter(case.values()))
    if first[0].key.magnetometer == WALK:
        print(f"the walk told of its iron on {sum(map(_was_calibrated, first))} of {len(first)} walks")
    for title, columns in {**TABLES, RATIOS: ratio_columns(case)}.items():
        heads, rows = table(columns, case, group, against)
        if len(heads) > 1:
            told = f"; the reduction is against {against}, each preset against its own" if REDUCED in heads else ""
            print(f"\n{title}{told}")
            harness.print_table(heads, rows)


RATIOS = "Error over that of others, walk by walk: at the landmarks, where there are any, else the rmse"


def ratio_columns(case: Case) -> list[Column]:
    """One column for each opponent that is there."""
    landmarks = any(result.landmark_m.get(AS_STARTED) for results in case.values() for result in results)
    value = STARTED_AT_LANDMARKS if landmarks else STARTED_RMSE
    return [Column(f"over {name}", "", partial(_over, value, case, name)) for name in OPPONENTS if name in case]


def _over(
    value: Callable[[Result, Result | None], float | None], case: Case, against: str, result: Result, _: Result | None
) -> float | None:
    theirs = _reference(case, result.key.method, against)
    return _ratio(value, result, theirs.get(result.key.walk))


def _was_calibrated(result: Result) -> bool:
    return any(note.startswith("corrected by the calibration") for note in result.notes)


def table(columns: Sequence[Column], case: Case, group: str, against: str) -> tuple[list[str], list[list[str]]]:
    """Head and rows; the paper's row below the method's."""
    values = {
        column: {
            method: _values(column, results, _reference(case, method, against)) for method, results in case.items()
        }
        for column in columns
    }
    shown = [column for column in columns if any(len(some) for some in values[column].values())]
    rows = []
    for method in case:
        rows.append([method, *(spread(values[column][method]) for column in shown)])
        paper = PAPERS.get((group, method_of(method).name))
        if paper is not None and any(column.paper in paper.printed for column in shown):
            rows.append([f"  {paper.words}", *(paper.printed.get(column.paper, "") for column in shown)])
    return ["method", *(column.head for column in shown)], rows


def _reference(case: Case, method: str, against: str) -> dict[str, Result]:
    """Results by walk of the method that this one is held against: in its own preset, if there are any."""
    name, preset = method_of(method).name, method_of(method).preset
    alike = against if name == method else f"{against}:{preset}"
    return {result.key.walk: result for result in case.get(alike, case.get(against, ()))}


def _values(column: Column, results: Sequence[Result], reference: Mapping[str, Result]) -> Floats:
    """Figures (W,) of the walks that have one, the worst where the method failed; none where it never has one."""
    some = [column.value(result, reference.get(result.key.walk)) for result in results if not result.failed]
    known = [value for value in some if value is not None]
    failures = 0 if column.failed is None or not known else len(results) - len(some)
    return np.array(known + [column.failed] * failures, dtype=np.float64)


def spread(values: Floats) -> str:
    """Median and the 5th and 95th percentile, in words; a figure that is not finite is a failure."""
    if not len(values):
        return "-"
    how = "linear" if np.isfinite(values).all() else "higher" if np.isposinf(values).any() else "lower"
    low, middle, high = np.percentile(values, [5, 50, 95], method=how)  # type: ignore[call-overload]
    return f"{_short(middle)} ({_short(low)} to {_short(high)})" if len(values) > 1 else _short(middle)


def _short(value: float) -> str:
    """Three digits, without an exponent."""
    if not math.isfinite(value):
        return "failed"
    digits = 2 if abs(value) < 10 else 1 if abs(value) < 100 else 0
    return f"{value:.{digits}f}"


def judged(cases: Mapping[str, Case]) -> list[Figure]:
    """Figures that were asked for, of the cases and methods that there are."""
    figures = []
    for name, case in cases.items():
        key = next(iter(case.values()))[0].key
        for method in case:
            base = method_of(method).name
            for asked in (one for one in ASKED if one.of(key.group, base, key.field)):
                figures += _judged(name, case, method, asked)
    return figures


def _judged(section: str, case: Case, method: str, asked: Asked) -> list[Figure]:
    column, bounds = asked.column, (asked.low, asked.upper(case[method][0].key.field))
    against = asked.against or REFERENCE.get(asked.group, OTHER_REFERENCE)
    theirs = _reference(case, method, against)
    values = _values(column, case[method], theirs)

    def figure(words: str, measured: float) -> Figure:
        source = f" ({asked.source})" if asked.source else ""
        return Figure(section, f"{column.head}{words}{source}", method, measured, *bounds, "{:.2f}")

    if not asked.against:
        return [figure("", _median(values))]
    if not theirs:
        return []
    each = _values(replace(column, value=partial(_ratio, column.value)), case[method], theirs)
    others = _median(_values(column, list(theirs.values()), {}))
    return [
        figure(f", over {against}, walk by walk", _median(each)),
        figure(f", over {against}, of medians", _median(values) / others if others else math.inf),
    ]


def _median(values: Floats) -> float:
    return float(np.median(values)) if len(values) else math.inf


def print_speed(results: Sequence[Result]) -> None:
    """Print what a sample costs each method."""
    costs: dict[str, list[float]] = {}
    for result in results:
        if result.samples:
            costs.setdefault(result.key.method, []).append(result.us_per_sample)
    harness.print_heading("Microseconds a sample, of all walks: the least is what a method costs on an idle machine")
    rows = [(name, _short(min(some)), spread(np.array(some))) for name, some in costs.items()]
    harness.print_table(("method", "least", "median (5 % to 95 %)"), rows)


def print_remarks(results: Sequence[Result]) -> None:
    """Print failures by their reason, and how many results are of other code."""
    out = console()
    failed = [result for result in results if result.failed]
    for result in failed[:10]:
        out.print(f"failed: {', '.join((result.key.group, result.key.walk, result.key.method))}: {result.failed}")
    if len(failed) > 10:
        out.print(f"and {len(failed) - 10} more failed")
    old = [result.key.method for result in results if result.code != code_sum()]
    if old:
        methods = ", ".join(dict.fromkeys(old))
        out.print(f"{len(old)} of {len(results)} results were made by other code ({methods}): --renew makes them anew")
