"""M-E1: Ma's calibration on the shoe beside CLSEF, Table 1 and Figure 7, over loops (`loop`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.reproduce.ma2018.loop import CLSEF, MA_B_UT, MA_K, MG_PER_UT, Loop, heading_errors
from fg_nav.lab.reproduce.results import (
    ABOVE,
    BELOW,
    Experiment,
    Picture,
    Reason,
    Row,
    Spread,
    one_line,
    reason_for,
    spread_of,
)
from fg_nav.lab.simulation.sensors.magnetometer import MA_ETA_RAD, MA_OFFSET_UT, MA_TAU

PRINTED, QUADRANT, FITTED, FREE = "as printed", "right quadrant", "fitted", "CLSEF"

ON_SHOE = {PRINTED: "ellipse, as printed", QUADRANT: "ellipse, by extremes", FITTED: "ellipse, fitted"}
"""Columns whose calibration is made on the shoe, by the names of `loop`."""

_CLOSE = 0.05
"""Tolerance of what is put in and found again."""

_SETTING = """Scenario calibration-loop: circles to the right and to the left in a field without steel, eight MPU-9250
in the heel, 400 Hz. Table 1 is what we put in: its first line is the iron of shoe and floor, its second the module
without the shoe, tumbled by hand for a minute. So its rows tell whether the method finds again what was there (put in),
and what the difference of the two lines costs CLSEF. As printed: Ma (6)-(12) to the letter; right quadrant: the
same with Ma (8) by atan2; fitted: our least squares; CLSEF: the ellipsoid of the tumbled module; as no ellipsoid tells
its scale from readings alone, K_c has the printed determinant. Figure 7 is the magnetic heading of the footfalls less
that of the gyroscope, about its mean."""

_ETA = """Ma (8) takes an arcsine, and so mirrors the long axis where the farthest reading lies at negative x; with the
right quadrant the axis is found (column beside)."""

_THEN = "Then the difference is within 5 deg, and so is that of our fit."


def calibration_experiment(loops: Sequence[Loop], pictures: Sequence[Picture]) -> Experiment:
    """All of Table 1 and Figure 7."""
    rows = (*_of_ellipse(loops), *_of_ellipsoid(loops), *_of_heading(loops))
    columns = (*ON_SHOE, FREE)
    return Experiment(
        "M-E1",
        "Calibration of the magnetometer on the shoe (Table 1, Figures 6 and 7)",
        one_line(_SETTING),
        columns,
        rows,
        pictures,
    )


def _of_ellipse(loops: Sequence[Loop]) -> Iterator[Row]:
    """First line of the table."""
    shapes: tuple[tuple[str, str, float, Callable[[Floats], float], str, tuple[Reason, ...]], ...] = (
        ("offset x", "mG", MG_PER_UT * MA_OFFSET_UT[0], lambda e: MG_PER_UT * e[0], "{:.1f}", ()),
        ("offset y", "mG", MG_PER_UT * MA_OFFSET_UT[1], lambda e: MG_PER_UT * e[1], "{:.1f}", ()),
        ("eta", "rad", MA_ETA_RAD, lambda e: e[2], "{:.3f}", (Reason(_ETA, ABOVE),)),
        ("tau", "", MA_TAU, lambda e: e[3], "{:.3f}", ()),
        ("R, first row, first element", "", 0.562, lambda e: np.cos(e[2]), "{:.3f}", (Reason(_ETA, BELOW),)),
        ("R, first row, second element", "", 0.827, lambda e: np.sin(e[2]), "{:.3f}", ()),
    )
    for name, unit, paper, value, pattern, why in shapes:
        ours = {
            column: spread_of([_or_failed(value(loop.ellipse[method])) for loop in loops])
            for column, method in ON_SHOE.items()
        }
        printed = f"{paper:.2f}" if unit == "mG" else f"{paper:.3f}"
        row = partial(Row, f"{name}", unit, printed, ours, paper, PRINTED, good=0, tolerance=_CLOSE)
        yield row(why=reason_for(why, "", ours[PRINTED].median - paper), pattern=pattern, whose="input")


def _or_failed(value: float) -> float:
    """A method that refused a loop leaves NaN, which counts as infinite."""
    return float(value) if np.isfinite(value) else np.inf


def _of_ellipsoid(loops: Sequence[Loop]) -> Iterator[Row]:
    """Second line of the table."""
    scale = np.linalg.det(MA_K)
    for axis, paper in zip("xyz", MG_PER_UT * MA_B_UT, strict=True):
        found = spread_of([MG_PER_UT * float(loop.B_uT["xyz".index(axis)]) for loop in loops])
        yield Row(
            f"B_c {axis}", "mG", f"{paper:.2f}", {FREE: found}, float(paper), FREE, 0, 0, _CLOSE, "", "{:.1f}", "input"
        )
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)):
        values = [float((loop.K * np.cbrt(scale / np.linalg.det(loop.K)))[i, j]) for loop in loops]
        paper = float(MA_K[i, j])
        tolerance = _CLOSE if i == j else 0.01 / abs(paper)
        ours = {FREE: spread_of(values)}
        yield Row(
            f"K_c {i + 1}{j + 1}",
            "",
            f"{paper:.3f}",
            ours,
            paper,
            FREE,
            0,
            0,
            tolerance,
            "",
            "{:.3f}",
            "input",
        )


def _of_heading(loops: Sequence[Loop]) -> Iterator[Row]:
    """Figure 7."""
    largest, rms = ({column: _heading(loops, method, k) for column, method in _all().items()} for k in (0, 1))
    ratios = {
        column: spread_of(list(heading_errors(loops, CLSEF)[0] / heading_errors(loops, method)[0]))
        for column, method in ON_SHOE.items()
    }
    yield Row(
        "largest difference of headings",
        "deg",
        "<= 5",
        largest,
        5.0,
        PRINTED,
        bound=1,
        pattern="{:.1f}",
        why=reason_for((Reason(f"{_ETA} {_THEN}", ABOVE),), "", largest[PRINTED].median - 5.0),
    )
    yield Row("the same, root mean square", "deg", "", rms, pattern="{:.1f}")
    yield Row("CLSEF's largest difference over it", "", "> 1", ratios, 1.0, PRINTED, bound=-1, good=1, whose="input")


def _all() -> dict[str, str]:
    return {**ON_SHOE, FREE: CLSEF}


def _heading(loops: Sequence[Loop], method: str, which: int) -> Spread:
    """Largest (0) or rms (1) difference over the loops; infinite where a method refused."""
    return spread_of([float(value) for value in heading_errors(loops, method)[which]])
