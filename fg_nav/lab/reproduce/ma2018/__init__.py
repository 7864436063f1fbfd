"""All experiments of Ma et al. (2018): calibration on the shoe, quasi-static detector, office and mall.

M-E1   the calibration beside CLSEF (Table 1, Figure 7): Ma (6)-(12), on the loops of `loop`
M-E2a  sigmas of the detector's channels, Ma (13), from hours of noise
M-E2b  its ROC with N = 3 (Figure 8). The paper says that beyond P_D = 0.8 P_FA rises much faster. Any curve above the
       diagonal rises faster at its end than on the whole, so that is no test; tested is the slope dP_FA/dP_D: from 0.8
       to 0.9 it must be at least twice that from 0.7 to 0.8
M-E3   office, M-E4 mall: each printed figure beside the filter it is of and beside ours. A column is how a filter is
       set (`fg_nav.ekf.presets`). Judged is the path as started; what the best turn and shift make of it stands beside,
       without a verdict: to choose the kinder way by the result would be no test

The filters as printed have what would break them corrected: the signs of Ma (1) and of Ma (38), (39), the row of H in
Ma (36).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.reproduce.drawing import Pictures
from fg_nav.lab.reproduce.ma2018 import detections, figures
from fg_nav.lab.reproduce.ma2018.detections import Case, noise_part, roc_part
from fg_nav.lab.reproduce.ma2018.figures import MALL, OFFICE, PRINTED
from fg_nav.lab.reproduce.ma2018.loop import CLSEF, MA_K, MG_PER_UT, Loop, heading_errors, loop_of, loop_part
from fg_nav.lab.reproduce.results import Spread, spread_of
from fg_nav.lab.reproduce.runner import Found, Made, Measures, Paper, Parts
from fg_nav.lab.reproduce.table import Line
from fg_nav.lab.reproduce.walks import FIGURES, Walks, reduction_over
from fg_nav.lab.roc import Band, Roc
from fg_nav.lab.store.results import Arrays

LOOPS, NOISES, ROCS = 20, 10, 10
"""The first seeds of a run that are enough: of loops, of walks for the sigmas (two hours), and for the ROC."""

REST_S, QUICK_REST_S = 7200.0, 600.0  # For so long the first seed's shoe lies on a table.

PHYSICAL, TUNED = "physical", "tuned"
DETECTORS = {PRINTED: detections.MA, PHYSICAL: detections.OURS}  # By column of M-E2b.

ON_SHOE = {PRINTED: "ellipse, as printed", "right quadrant": "ellipse, by extremes", "fitted": "ellipse, fitted"}
CALIBRATIONS = ON_SHOE | {"CLSEF": CLSEF}  # By column of M-E1.


def list_parts(seeds: Sequence[int], quick: bool) -> Parts:
    """Detections, noise and loops."""
    rest_s = QUICK_REST_S if quick else REST_S
    return {
        "roc": [roc_part(MALL, seed) for seed in seeds[:ROCS]],
        "noise": [noise_part(seed, 0.0 if k else rest_s) for k, seed in enumerate(seeds[:NOISES])],
        "loop": [loop_part(seed) for seed in seeds[:LOOPS]],
    }


def read_run(made: Made) -> Found:
    """What each row is read off, and the paper's figures."""
    loops = [loop_of(arrays) for arrays in made.load("loop")]
    rocs = made.load("roc")
    cases = {field: Case(field, rocs) for field in detections.FIELDS}
    measures: Measures = {
        **_calibration(loops),
        "sigma": partial(_sigma, made.load("noise")),
        **{name: partial(_roc_figure, cases, figure) for name, figure in ROC_FIGURES.items()},
        "wrong": partial(_wrong_where_it_passes, cases),
        "over_straight": partial(_over_straight, cases),
        "end_at_heading": partial(_end_at_heading, made),
        "reduction": partial(_reduction, made),
    }
    drawn = figures.draw_all(Pictures(made.folder), made, loops[0], cases)
    return Found(measures, drawn)


PAPER = Paper(list_parts, read_run)


# --- M-E1, M-E2a: calibration and noise ------------------------------------------------------------------------------


def _calibration(loops: Sequence[Loop]) -> Measures:
    """Figures of Table 1 and Figure 7, over the loops; a method that refused a loop is infinitely wrong."""

    def of_shape(read: Callable[[Floats, Line], float]) -> Callable[[Line], dict[str, Spread]]:
        return lambda line: {
            column: spread_of(_known([read(loop.ellipse[method], line) for loop in loops]))
            for column, method in ON_SHOE.items()
        }

    def of_matrix(line: Line) -> dict[str, Spread]:  # no ellipsoid gives its scale from readings alone
        i, j = (int(index) for index in line.measure[1:])
        scaled = [loop.K * np.cbrt(np.linalg.det(MA_K) / np.linalg.det(loop.K)) for loop in loops]
        return {"CLSEF": spread_of(_known([float(K[i, j]) for K in scaled]))}

    errors = {column: heading_errors(loops, method) for column, method in CALIBRATIONS.items()}
    bare = errors["CLSEF"][0]
    return {
        "offset": of_shape(lambda shape, line: MG_PER_UT * shape[int(line.measure[1])]),
        "eta": of_shape(lambda shape, _: shape[2]),
        "cosine": of_shape(lambda shape, _: float(np.cos(shape[2]))),
        "sine": of_shape(lambda shape, _: float(np.sin(shape[2]))),
        "tau": of_shape(lambda shape, _: shape[3]),
        "B": lambda line: {"CLSEF": spread_of(_known([MG_PER_UT * one.B_uT[int(line.measure[1])] for one in loops]))},
        "K": of_matrix,
        "largest": lambda _: {column: spread_of(largest.tolist()) for column, (largest, _) in errors.items()},
        "rms": lambda _: {column: spread_of(rms.tolist()) for column, (_, rms) in errors.items()},
        "over_largest": lambda _: {column: spread_of((bare / errors[column][0]).tolist()) for column in ON_SHOE},
    }


def _known(values: Sequence[float]) -> list[float]:
    return [float(value) if np.isfinite(value) else np.inf for value in values]


def _sigma(noises: Sequence[Arrays], line: Line) -> dict[str, Spread]:
    """Sigma of one channel: heading, inclination, strength."""
    channel, scale = int(line.measure[1]), MG_PER_UT if line.unit == "mG" else 1.0
    columns = {"walked": detections.WALKED, "iron on": detections.IRON_ON, "at rest, one seed": detections.AT_REST}
    return {
        column: spread_of([scale * float(noise[stored][channel]) for noise in noises if stored in noise])
        for column, stored in columns.items()
    }


# --- M-E2b: detections -----------------------------------------------------------------------------------------------


def _roc_figure(
    cases: Mapping[str, Case], figure: Callable[[Roc, Sequence[float]], Spread], line: Line
) -> dict[str, Spread]:
    """By column; none where there are too few stances of a kind."""
    rocs = {column: cases[line.of].roc(detector) for column, detector in DETECTORS.items()}
    arguments = [float(value) for value in line.measure[1:]]
    return {column: figure(roc, arguments) for column, roc in rocs.items() if roc is not None}


def _with_band(roc: Roc, value: float, band: Callable[[], Band]) -> Spread:
    """With the band over walks, where there are two or more."""
    if roc.n_walks < 2:
        return Spread(value, value, value, roc.n_walks)
    found = band()
    return Spread(value, found.low, found.high, roc.n_walks)


def slope(roc: Roc, arguments: Sequence[float]) -> Spread:
    """dP_FA/dP_D between a P_D and the next tenth."""
    [low] = arguments
    value = float(np.diff(np.interp([low, low + 0.1], roc.p_d, roc.p_fa))[0] / 0.1)
    return Spread(value, value, value, roc.n_walks)


def bend(roc: Roc, arguments: Sequence[float]) -> Spread:
    """Slope beyond the paper's knee over that before; of no walk where the curve is flat before it."""
    [knee] = arguments
    before, beyond = slope(roc, [knee - 0.1]).median, slope(roc, [knee]).median
    value = beyond / before if before > 0.0 else np.nan
    return Spread(value, value, value, roc.n_walks if before > 0.0 else 0)


ROC_FIGURES: Mapping[str, Callable[[Roc, Sequence[float]], Spread]] = {
    "p_d": lambda roc, _: _with_band(roc, roc.at(1.0)[0], lambda: roc.band_at(1.0)[0]),
    "p_fa": lambda roc, _: _with_band(roc, roc.at(1.0)[1], lambda: roc.band_at(1.0)[1]),
    "area": lambda roc, _: _with_band(roc, roc.area, roc.area_band),
    "slope": slope,
    "bend": bend,
}


def _wrong_where_it_passes(cases: Mapping[str, Case], line: Line) -> dict[str, Spread]:
    """Median over the footfalls of each walk of the error of a perfect compass."""
    case, found = cases[line.of], {}
    wrong_deg = case.column("wrong_deg")
    for column, detector in DETECTORS.items():
        passes = case.passes(detector)
        each = [wrong_deg[passes & (case.walk == walk)] for walk in range(len(case.walks))]
        found[column] = spread_of([float(np.nanmedian(wrong)) for wrong in each if len(wrong)])
    return found


def _over_straight(cases: Mapping[str, Case], line: Line) -> dict[str, Spread]:
    """Share of the footfalls on curves that pass, over that of those on straights, walk by walk (Figures 13, 14)."""
    case, found = cases[str(line.measure[1])], {}
    course_deg = case.column("course_deg")
    straight, curved = course_deg < detections.STRAIGHT_DEG, course_deg >= detections.CURVED_DEG
    for column, detector in ((PRINTED, f"{line.of}-printed"), (PHYSICAL, line.of)):
        passes, ratios = case.passes(detector), []
        for walk in range(len(case.walks)):
            on_curves, on_straights = (passes[part & (case.walk == walk)] for part in (curved, straight))
            if len(on_curves) and on_straights.any():
                ratios.append(float(on_curves.mean() / on_straights.mean()))
        found[column] = spread_of(ratios)
    return found


# --- M-E3, M-E4: besides figures of single walks ---------------------------------------------------------------------


def _end_at_heading(made: Made, line: Line) -> dict[str, Spread]:
    """Final position error in the office at a heading error in deg, on the line through our walks."""
    columns = made.table.filters[line.of]
    return {
        column: _on_line(made.walks, line.level, method, float(line.measure[1])) for column, method in columns.items()
    }


def _on_line(walks: Walks, level: str, method: str, heading_deg: float) -> Spread:
    """By least squares; of no walk where there is no line."""
    results = [one for one in walks.of(OFFICE, level, method) if not one.failed]
    pairs = [(FIGURES["heading_deg"](one), FIGURES["end_m"](one)) for one in results]
    known = np.array([pair for pair in pairs if None not in pair], dtype=np.float64)
    if len(known) < 2 or np.ptp(known[:, 0]) == 0.0:
        return Spread(np.nan, np.nan, np.nan, 0)
    value = float(np.polynomial.Polynomial.fit(known[:, 0], known[:, 1], 1)(heading_deg))
    return Spread(value, value, value, len(known))


def _reduction(made: Made, line: Line) -> dict[str, Spread]:
    """By how much a figure of the mall is below that of the other filter in the same setting, walk by walk."""
    others, figure = made.table.filters[line.over], FIGURES[str(line.measure[1])]
    return {
        column: reduction_over(
            made.walks.of(MALL, line.level, method),
            made.walks.of(MALL, line.level, others[column if column in (PRINTED, PHYSICAL) else TUNED]),
            figure,
        )
        for column, method in made.table.filters[line.of].items()
    }
