"""M-E3 and M-E4: Ma's office and mall, each printed figure beside the filter it is of and beside ours.

A column is how a filter is set (`fg_nav.ekf.presets`); the smoother, with and without the field, has one setting. The
verdict is of the filter as printed, and a printed bound is held or not, without a tolerance. The pure ZUPT filter has
no detector and no compass, and does not depend on the field; as printed it has OpenShoe's noise, as the others have.

Judged is the path as started. What the best turn and shift make of it stands beside, with the paper's words and without
a verdict: the paper does not give its own way, and to choose the kinder one by the result would be no test.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from fg_nav.lab.reproduce import walks as read
from fg_nav.lab.reproduce.ma2018.detections import CURVED_DEG, STRAIGHT_DEG, Case
from fg_nav.lab.reproduce.ma2018.magnetometer import curve_rows
from fg_nav.lab.reproduce.results import ABOVE, BELOW, Experiment, Picture, Reason, Row, Spread, one_line, reason_for
from fg_nav.lab.reproduce.walks import Figure, Walks
from fg_nav.lab.store.results import Key, Result
from fg_nav.lab.walked import BEST_YAW

OFFICE, MALL = "office", "mall"
ZUPT, IQSF, PROPOSED, SMOOTHER, INERTIAL = "iez", "iqsf", "ma2018", "smoother", "inertial"

PRINTED, PHYSICAL, TUNED, NO_FIELD, OURS = "as printed", "physical", "tuned", "no field", "smoother"
BOTH_WAYS = "matched, both ways"
COLUMNS = (PRINTED, PHYSICAL, TUNED, BOTH_WAYS, NO_FIELD, OURS)
"""Settings of a filter, the filter that assumes what the smoother assumes, run forth and back, the smoother without
the field, and the smoother."""

PRESET = {PRINTED: ":as-printed", PHYSICAL: ":physical", TUNED: ""}

MATCHED = "matched-rts"

METHODS = (
    *(ZUPT + PRESET[column] for column in (PRINTED, TUNED)),
    *(name + preset for name in (IQSF, PROPOSED) for preset in PRESET.values()),
    MATCHED,
    INERTIAL,
    SMOOTHER,
)

NAMES = {ZUPT: "pure ZUPT", IQSF: "iQSF", PROPOSED: "proposed"}  # The paper's words for its filters.


def keys(fields: Sequence[str], seeds: Sequence[int]) -> list[Key]:
    """All that both experiments look at."""
    return [key for scenario in (OFFICE, MALL) for key in read.keys_of(scenario, fields, METHODS, seeds)]


def columns_of(filter_name: str) -> dict[str, str]:
    """Methods by column, for the rows of one filter."""
    if filter_name == ZUPT:
        return {PRINTED: ZUPT + PRESET[PRINTED], TUNED: ZUPT, NO_FIELD: INERTIAL}
    filters = {column: filter_name + preset for column, preset in PRESET.items()}
    return filters | ({BOTH_WAYS: MATCHED} if filter_name == PROPOSED else {}) | {OURS: SMOOTHER}


@dataclass(frozen=True)
class Printed:
    """A figure of the paper, and its words.

    Attributes
    ----------
    quantity, unit, figure : what it is of a walk.
    filter_name : whose it is.
    words, paper : as it stands in the paper, and as a number.
    bound, pattern, whose : as of a `Row`.
    why : reasons of a difference.
    """

    quantity: str
    unit: str
    figure: Figure
    filter_name: str
    words: str = ""
    paper: float | None = None
    bound: int = 0
    pattern: str = "{:.2f}"
    why: tuple[Reason, ...] = ()
    whose: Literal["paper", "input"] = "paper"

    def row(self, walks: Walks, scenario: str, field: str) -> Row:
        """Beside ours, over all walks of a field."""
        ours = {
            column: read.spread_over(results, self.figure)
            for column, method in columns_of(self.filter_name).items()
            if (results := walks.of(scenario, field, method))
        }
        quantity = f"{self.quantity}, {NAMES[self.filter_name]}{'' if self.filter_name == ZUPT else f', {field}'}"
        off = 0.0 if self.paper is None or PRINTED not in ours else ours[PRINTED].median - self.paper
        why, good = reason_for(self.why, field, off), -1 if self.filter_name == PROPOSED else 0
        row = Row(quantity, self.unit, self.words, ours, self.paper, PRINTED, self.bound, good, why=why)
        return replace(row, pattern=self.pattern, whose=self.whose)


_INDOOR, _SMOOTH = "indoor", "smooth"

_CALIBRATED = """How the module was calibrated is not printed, and it decides what the gyroscope drifts. That ours was
calibrated at all was chosen by this figure: raw modules end several times as far off. One walk of one module, it lies
within the spread of ours."""

_LOOPS = """The end of this closed way follows the final heading: the next row is what the printed heading makes of it
in each of our filters, whatever their noise. What is left is a way of another shape, or errors besides the heading."""

_CLOSED = """As printed the gate is closed on this floor, whose field changes from stride to stride by far more than the
noise that its threshold stands for. No footfall is accepted, and what is left is a ZUPT filter with OpenShoe's noise
and no compass, the same as pure ZUPT as printed. What that comes to is chance: the printed figure lies within the
spread. Tuned, the gate is open."""

_FEW = """170 lets few of the footfalls pass on this floor (rows of accepted footfalls). Their compass is off by more
(M-E2b) than the printed 3.8 deg that it is taken in with; tuned, most footfalls pass, with 30 deg each, and the
deviations of the places average out."""

_ALIKE = """What passes on this field is taken in with the printed 3.8 deg, each footfall for itself, though neighbours
err alike: the path follows the deviations. Tuned, which takes the compass in with 30 deg, ends nearer. The bound is
within the spread."""

_TURNED = """Much of it is a turn of the whole path: laid by the best turn and shift, as the paper may have done, the
figure is the printed one within the tolerance of a row (row below, not judged). The path turns because nearly every
footfall passes on this field and its compass is taken in with the printed 3.8 deg, each for itself, though neighbouring
ones err alike. Physical, which accepts fewer of them, and tuned, which takes the compass in with 30 deg, come
nearer."""

_HELD = """On this field iQSF as printed accepts more than half of the footfalls, enough to hold its heading; in the
paper it hardly found any in the mall. No way of laying the path changes that."""

_BOTH = """The proposed filter as printed is worse than iQSF on this field. iQSF too accepts more than half of the
footfalls, and a heading once in a while is enough. The paper's factor is that of a filter with a compass over one
without, as on the other field."""

_APART = """It is a ratio of two errors that are both more than twice the printed ones (rows above), over an iQSF that
accepts no footfall: a filter with few compasses over one with none. On single walks it comes out anywhere (see the
spread)."""


OFFICE_ROWS = (
    Printed("final position error", "m", read.end_m, ZUPT, "2", 2.0, why=(Reason(_LOOPS, BELOW),)),
    Printed("final heading error", "deg", read.heading_deg, ZUPT, "14", 14.0, pattern="{:.1f}", whose="input",
            why=(Reason(_CALIBRATED, BELOW),)),
    Printed("mean position error", "m", read.mean_m, ZUPT),
    Printed("final position error", "m", read.end_m, IQSF, "<= 0.5", 0.5, 1,
            why=(Reason(_CLOSED, ABOVE, _INDOOR), Reason(_ALIKE, ABOVE, _SMOOTH))),
    Printed("final position error", "m", read.end_m, PROPOSED, "<= 0.5", 0.5, 1,
            why=(Reason(_FEW, ABOVE, _INDOOR), Reason(_ALIKE, ABOVE, _SMOOTH))),
    Printed("the same over the way (TTD)", "%", read.end_percent, PROPOSED),
    Printed("final heading error", "deg", read.heading_deg, IQSF, pattern="{:.1f}"),
    Printed("final heading error", "deg", read.heading_deg, PROPOSED, pattern="{:.1f}"),
    Printed("mean position error", "m", read.mean_m, PROPOSED),
    Printed("footfalls with an accepted field", "%", read.used_percent, IQSF, pattern="{:.0f}"),
    Printed("footfalls with an accepted field", "%", read.used_percent, PROPOSED, pattern="{:.0f}"),
)  # fmt: skip

_OF_IQSF = (Reason(_CLOSED, ABOVE, _INDOOR), Reason(_HELD, BELOW, _SMOOTH))
_OF_PROPOSED = (Reason(_FEW, ABOVE, _INDOOR), Reason(_TURNED, ABOVE, _SMOOTH))

LAID = ", best turn and shift"  # After what a figure of the mall is of.

_LAID_MAX, _LAID_MEAN = (
    partial(read.walk_error, name="max_m", mode=BEST_YAW),
    partial(read.at_landmarks, of=read.mean, mode=BEST_YAW),
)


def _both_ways(judged: Printed, laid: Figure) -> tuple[Printed, Printed]:
    """A figure judged as started, and beside it by the best turn and shift, not judged."""
    beside = replace(judged, quantity=judged.quantity + LAID, figure=laid, paper=None, why=())
    return judged, beside


_MEAN, _LARGEST = "mean error at 42 landmarks", "largest error"

MALL_ROWS = (
    Printed(_MEAN, "m", read.landmark_mean_m, ZUPT),
    *_both_ways(Printed(_LARGEST, "m", read.max_m, IQSF, "51", 51.0, pattern="{:.1f}", why=_OF_IQSF), _LAID_MAX),
    *_both_ways(Printed(_LARGEST, "m", read.max_m, PROPOSED, "3", 3.0, pattern="{:.1f}", why=_OF_PROPOSED), _LAID_MAX),
    *_both_ways(Printed(_MEAN, "m", read.landmark_mean_m, IQSF, "11.3", 11.3, why=_OF_IQSF), _LAID_MEAN),
    *_both_ways(Printed(_MEAN, "m", read.landmark_mean_m, PROPOSED, "1.5", 1.5, why=_OF_PROPOSED), _LAID_MEAN),
    Printed("largest error at a landmark", "m", read.landmark_max_m, IQSF, pattern="{:.1f}"),
    Printed("largest error at a landmark", "m", read.landmark_max_m, PROPOSED, pattern="{:.1f}"),
    Printed("the largest error over the way (TTD)", "%", lambda result: _share(result, read.max_m), PROPOSED),
    Printed("footfalls with an accepted field", "%", read.used_percent, IQSF, pattern="{:.0f}"),
    Printed("footfalls with an accepted field", "%", read.used_percent, PROPOSED, pattern="{:.0f}"),
)


def _share(result: Result, figure: Figure) -> float | None:
    """In percent of the way."""
    value, errors = figure(result), result.errors.get("origin")
    return None if value is None or errors is None else 100.0 * value / errors.distance_m


_SETTING = """{scenario}. Magnetometer calibrated on a loop of the same shoe, all methods given the heading at the
start. Medians over the walks (5 to 95 %), laid on the truth as started where nothing else is said. Columns: the filter
as printed (detector, threshold and values of the paper; noise of OpenShoe where none is printed), physical (as physics
has it), tuned (on seeds below 100, one setting for both fields: on one alone another may be better, as physical is for
the proposed filter in the mall on smooth), matched (the proposed filter that assumes of foot and sensor what the
smoother assumes, run forth and back), the smoother without the field and with it. Smoother and matched are given the
whole walk before they answer, the other filters are not; and the smoother measures the compass's noise on each walk.
Pure ZUPT has no gate, and the smoother one setting. What the field of the paper's building was like is not known: ours
is smooth (large iron some metres away) or indoor (a reinforced floor, fitted to real walks)."""

_OFFICE = (
    "Scenario office: three equal loops through corridors, 1018 m, 786 strides, eight MPU-9250 in the heel, 400 Hz"
)

_MALL = "Scenario mall: three winding laps past 14 landmarks, 2480 m, 1920 strides, the same shoe and sensor"

_CURVES = f"""The printed reduction of 85 % is 86.7 % by the printed means. Figures 13 and 14: of the footfalls whose
three strides differ by {CURVED_DEG:g} deg or more in direction, and of those on straights ({STRAIGHT_DEG:g} deg at
most), the shares that pass: of iQSF on the field smooth, of the proposed detector on between (M-E2b), as it passes all
on smooth."""


def office_experiment(walks: Walks, fields: Sequence[str], pictures: Sequence[Picture]) -> Experiment:
    """Figures 9 to 11."""
    rows = list(_rows(OFFICE_ROWS, walks, OFFICE, fields))
    rows.insert(1, _at_printed_heading(walks, fields[0]))
    setting = one_line(_SETTING.format(scenario=_OFFICE))
    return Experiment("M-E3", "Office, three loops (Figures 9 to 11)", setting, COLUMNS, rows, pictures)


def _at_printed_heading(walks: Walks, field: str) -> Row:
    """What the paper's final heading error makes of the position, by the line through our walks."""
    found = {
        column: _on_line(walks.of(OFFICE, field, method), _PRINTED_DEG) for column, method in columns_of(ZUPT).items()
    }
    words = f"the same where the heading ends {_PRINTED_DEG:g} deg off, on the line through the walks"
    return Row(f"{words}, {NAMES[ZUPT]}", "m", "", {column: one for column, one in found.items() if one.n})


_PRINTED_DEG = 14.0


def _on_line(results: Sequence[Result], heading: float) -> Spread:
    """Final position error in m at this heading error in deg, by least squares; NaN of none where there is no line."""
    pairs = [(read.heading_deg(result), read.end_m(result)) for result in results if not result.failed]
    known = np.array([pair for pair in pairs if None not in pair], dtype=np.float64)
    if len(known) < 2 or np.ptp(known[:, 0]) == 0.0:
        return Spread(np.nan, np.nan, np.nan, 0)
    value = float(np.polynomial.Polynomial.fit(known[:, 0], known[:, 1], 1)(heading))
    return Spread(value, value, value, len(known))


def mall_experiment(
    walks: Walks, fields: Sequence[str], cases: Mapping[str, Case], pictures: Sequence[Picture]
) -> Experiment:
    """Figures 12 to 16."""
    setting = one_line(_SETTING.format(scenario=_MALL)) + " " + one_line(_CURVES)
    rows = [*_rows(MALL_ROWS, walks, MALL, fields), *_reductions(walks, fields), *curve_rows(cases)]
    title = "Shopping mall, 42 passes of landmarks (Figures 12 to 16)"
    return Experiment("M-E4", title, setting, COLUMNS, rows, pictures)


def _rows(figures: Sequence[Printed], walks: Walks, scenario: str, fields: Sequence[str]) -> Iterator[Row]:
    """Each figure in each field; that of a filter without a compass once."""
    for one in figures:
        for field in fields[:1] if one.filter_name == ZUPT else fields:
            yield one.row(walks, scenario, field)


def _reductions(walks: Walks, fields: Sequence[str]) -> Iterator[Row]:
    """By how much the mean error at the landmarks is below that of iQSF in the same setting, walk by walk."""
    for field in fields:
        ours = {
            column: read.reduction_over(
                walks.of(MALL, field, columns_of(PROPOSED)[column]),
                walks.of(MALL, field, columns_of(IQSF)[column if column in PRESET else TUNED]),
                read.landmark_mean_m,
            )
            for column in columns_of(PROPOSED)
        }
        off = ours[PRINTED].median - _REDUCTION
        why = reason_for((Reason(_BOTH, BELOW, _SMOOTH), Reason(_APART, BELOW, _INDOOR)), field, off)
        quantity = f"reduction of iQSF's mean, proposed, {field}"
        yield Row(quantity, "%", "85", ours, _REDUCTION, PRINTED, 0, 1, 0.15, why, "{:.0f}")


_REDUCTION = 85.0  # As printed; the printed means give 86.7.
