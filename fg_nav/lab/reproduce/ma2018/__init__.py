"""All experiments of Ma et al. (2018): calibration on the shoe, quasi-static detector, office and mall.

What each is, and what its columns are, stands in `table.toml`; here is what that leaves open.

M-E1, Ma (6)-(12). The iron of shoe and floor is the levelled line of Table 1 (`ma_table_1`) in the mean true attitude
of this walk's stances. The table does not give the vertical iron on the shoe; there is none here. The other line is
that of the module without the shoe, the K_c and B_c of CLSEF, along the levelled axes; C is taken upper triangular, as
the paper has it.

M-E2a. Sigmas of the detector's channels, Ma (13).

M-E2b. The truth of a stance is the change of the true field over its window (`fg_nav.lab.field_survey`). What is
quasi-static depends on how much steel there is, so there are three fields, each with its own limit: in the median over
a window the field changes at the foot by 3 uT in `smooth`, by about 10 in `between` (0.6 of smooth and 0.4 of indoor)
and by 27 in `indoor`, which is fitted to real walks over reinforced floors. With one seed all have the same steps and
the same noise. Hard and soft iron are removed as drawn. AIEZ's statistic depends on its own threshold, for what passes
corrects the heading it is compared with. Any ROC above the diagonal rises faster at its end than on the whole, so that
is no test of the paper's "much faster": tested is the slope dP_FA/dP_D, which from 0.8 to 0.9 must be twice that from
0.7 to 0.8.

M-E3, M-E4. Judged is the path as started; what the best turn and shift make of it stands beside, without a verdict: to
choose the kinder way by the result would be no test. The filters as printed have what would break them corrected: the
signs of Ma (1) and of Ma (38), (39), the row of H in Ma (36).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats, Ints, interpolate_columns
from fg_nav.calibration.ellipsoid import Ellipse, calibrate_on_loop, fit_ellipsoid, half_turn, select_levelled
from fg_nav.detection import detect_stances
from fg_nav.errors import CalibrationError
from fg_nav.frames import wrap_angle
from fg_nav.lab import palette
from fg_nav.lab.campaign.walks import LOOP, RAW, Simulated
from fg_nav.lab.field_survey import measure_compass_deviation, measure_course_change, measure_field_change
from fg_nav.lab.reproduce.drawing import new_panels
from fg_nav.lab.reproduce.results import NOTHING, Line, Spread, spread_of
from fg_nav.lab.reproduce.roc import Roc, make_roc
from fg_nav.lab.reproduce.runner import WALK_FIGURES, Found, Made, Measures, Paper, Parts, reduction_over
from fg_nav.lab.simulation import SCENARIOS, Choices, scenario, simulate
from fg_nav.lab.simulation.fields import SITES
from fg_nav.lab.simulation.plan import Stand
from fg_nav.lab.simulation.sensors import SensorPrior, ma_table_1, make_iron, preset
from fg_nav.lab.simulation.walk import Streams
from fg_nav.lab.store.results import Arrays, Measurement
from fg_nav.magnetic import DETECTORS, FootfallField, average_footfall_field, judge_field
from fg_nav.magnetic.footfall_field import (
    compute_field_heading,
    compute_inclination,
    compute_level_R_body,
    integrate_attitude,
    rotate_to_level,
)
from fg_nav.report.plots import style

LOOPS, NOISES, ROCS = 20, 10, 10  # The first seeds of a run that are enough; ten walks for the sigmas are two hours.
REST_S, QUICK_REST_S = 7200.0, 600.0  # For so long the first seed's shoe lies on a table.

CIRCLES, OFFICE, MALL = "calibration-loop", "office", "mall"
SENSOR = "mpu-9250x8"
PRINTED, PHYSICAL, TUNED = "as printed", "physical", "tuned"  # Columns.

MA_K = np.array([[1.027, 0.037, 0.046], [0.0, 1.018, -0.002], [0.0, 0.0, 1.062]])  # K_c of Table 1, CLSEF.
MA_B_UT = np.array([14.336, 7.975, -5.641])  # B_c of Table 1, CLSEF: readings less B_c, times K_c, are the field.
TUMBLED_S, MG_PER_UT = 60.0, 10.0
CLSEF = "CLSEF, bare"
ON_SHOE = {PRINTED: "ellipse, as printed", "right quadrant": "ellipse, by extremes", "fitted": "ellipse, fitted"}
CALIBRATIONS = ON_SHOE | {"CLSEF": CLSEF}  # By column of M-E1.

WALKED, IRON_ON, AT_REST = "walked", "iron on", "at rest"
SIGMAS = {WALKED: WALKED, IRON_ON: IRON_ON, "at rest, one seed": AT_REST}  # By column of M-E2a.

WINDOW = 3  # Strides of a window, as Ma has it; one truth for all detectors, whatever their own windows.
BETWEEN = "between"  # The field in which there are stances of both kinds.
LIMIT_UT = {"smooth": 2.0, BETWEEN: 10.0, "indoor": 20.0}  # Of the change of the vector over a window.
MA, MA_THRESHOLD, OURS = "ma2018-printed", 170.0, "ma2018"
JUDGED_BY = {PRINTED: MA, PHYSICAL: OURS}  # Detectors by column of M-E2b.
STRAIGHT_DEG, CURVED_DEG = 5.0, 15.0  # Of a window's three strides the directions differ by less, or by more.
FEWEST = 20  # Cases of a kind without which no ROC is drawn from them.


def list_parts(seeds: Sequence[int], quick: bool) -> Parts:
    """Detections, noise and loops."""
    rests = [QUICK_REST_S if quick else REST_S, *[0.0] * NOISES]
    return {
        "roc": [
            Measurement(f"ma2018_roc_{MALL}_{seed}", partial(measure_detections, MALL, seed)) for seed in seeds[:ROCS]
        ],
        "noise": [
            Measurement(f"ma2018_noise_{seed}_{rest_s:.0f}s", partial(measure_noise, seed, rest_s))
            for seed, rest_s in zip(seeds[:NOISES], rests, strict=False)
        ],
        "loop": [Measurement(f"ma2018_loop_{seed}", partial(walk_loop, seed)) for seed in seeds[:LOOPS]],
    }


def read_run(made: Made) -> Found:
    """What each row is read off, and the paper's figures."""
    loops = made.load("loop")
    cases = {field: Case(field, made.load("roc")) for field in LIMIT_UT}
    measures: Measures = {
        **measure_calibration(loops),
        "sigma": partial(measure_sigma, made.load("noise")),
        **dict.fromkeys(("p_d", "p_fa", "area", "slope", "bend"), partial(measure_roc, cases)),
        "wrong": partial(measure_wrong_where_it_passes, cases),
        "over_straight": partial(measure_over_straight, cases),
        "end_at_heading": partial(measure_end_at_heading, made),
        "reduction": partial(measure_reduction, made),
    }
    return Found(measures, {"M-E1": {"": draw_headings(loops[0])}, "M-E2b": {"": draw_rocs(cases)}})


PAPER = Paper(list_parts, read_run)


# --- M-E1: calibration -----------------------------------------------------------------------------------------------


def walk_loop(seed: int) -> Arrays:
    """Walk the loop of a seed with Ma's iron, and calibrate by each method.

    `ellipse/METHOD` has offset x, y uT, eta rad and tau; `heading/METHOD` the differences (F,) rad. `K` (3, 3) and
    `B_uT` (3,) are what the readings without the shoe give, the scale of K being unknown. Empty or infinite where a
    method refused.
    """
    choices = Choices(field="homogeneous")
    # iron as in Table 1, in the mean true attitude of the stances
    walk = simulate(CIRCLES, seed, choices)
    stillest = detect_stances(walk.recording).stillest(walk.recording.gyr)
    R = compute_level_R_body(walk.attitude[stillest, 2].mean(axis=0))
    on_shoe = replace(scenario(CIRCLES), sensor=preset(SENSOR).with_iron(ma_table_1(R)))
    recording = simulate(on_shoe, seed, choices).recording
    field = average_footfall_field(recording, detect_stances(recording))
    arrays: dict[str, Floats] = {"K": np.full((3, 3), np.nan), "B_uT": np.full(3, np.nan)}
    # on the shoe, by each way to the ellipse of the levelled field
    ways: dict[str, Callable[[FootfallField], Ellipse]] = {
        "ellipse, fitted": lambda field: calibrate_on_loop(field)[0],
        "ellipse, as printed": lambda field: find_ellipse_as_printed(field.level_field[:, :2]),
        "ellipse, by extremes": lambda field: find_ellipse_by_extremes(field.level_field[:, :2]),
    }
    for name, find in ways.items():
        arrays |= {f"ellipse/{name}": np.full(4, np.inf), f"heading/{name}": np.empty(0)}
        with suppress(CalibrationError):
            found = find(field)
            arrays[f"ellipse/{name}"] = np.array([*found.offset_uT, found.eta_rad % np.pi, found.tau])
            arrays[f"heading/{name}"] = compute_difference(field, found.correct(field.level_field[:, :2]))
    # without the shoe, by an ellipsoid
    arrays[f"heading/{CLSEF}"] = np.empty(0)
    with suppress(CalibrationError):
        iron = make_iron(R.T @ MA_B_UT, R.T @ np.linalg.inv(MA_K) @ R)
        bare = fit_ellipsoid(tumble(preset(SENSOR).with_iron(iron), seed))
        # upper triangular with the same strengths, as K_c of Table 1: the corrected field is turned by the difference
        correction = R @ bare.correction @ R.T
        K = np.asarray(np.linalg.cholesky(correction.T @ correction).T)
        arrays |= {"K": K, "B_uT": R @ bare.hard_iron_uT}
        corrected = (field.body_field - bare.hard_iron_uT) @ (R.T @ K @ R).T
        level = rotate_to_level(corrected, field.nav_R_body[:, 2])
        arrays[f"heading/{CLSEF}"] = compute_difference(field, level)
    return arrays


def tumble(prior: SensorPrior, seed: int) -> Floats:
    """Readings (N, 3) of the sensor turned about by hand for a minute, all ways, in the field of Munich."""
    rng = np.random.default_rng([seed, 7])
    t = np.asarray(np.arange(int(TUMBLED_S * prior.rate_hz)) * prior.period_s, dtype=np.float64)
    rate = 2.0 * np.sin(t[:, None] * rng.uniform(0.3, 1.0, 3) + rng.uniform(0, 2 * np.pi, 3))
    nav_R_body = Rotation.random(random_state=rng).as_matrix()
    attitude = np.empty((len(t), 3, 3))
    for k, turn in enumerate(Rotation.from_rotvec(rate * prior.period_s).as_matrix()):
        attitude[k] = nav_R_body
        nav_R_body = nav_R_body @ turn
    body_field = np.einsum("nji,j->ni", attitude, SITES["munich"].at(np.zeros((1, 3)))[0])
    still = np.zeros_like(body_field)
    run = prior.draw(Streams(seed, CIRCLES).lasting("sensor")).switch_on(rng)  # the same sensor as on the shoe
    mag = run.measure(t, still, still, lambda at: interpolate_columns(at, t, body_field)).mag
    assert mag is not None
    return mag


def compute_difference(field: FootfallField, level_field: Floats) -> Floats:
    """Magnetic minus gyro heading (F,) rad of footfalls with a field, less the mean direction."""
    known = np.isfinite(level_field).all(axis=1)
    turned = wrap_angle(compute_field_heading(level_field) - field.gyro_heading)[known]
    return wrap_angle(turned - np.angle(np.exp(1j * turned).mean()))


def find_ellipse_by_extremes(level_xy: Floats) -> Ellipse:
    """Find the ellipse from extremes: Ma (6)-(8) with eta = atan2(m_y1, m_x1) modulo pi. No covariance.

    `level_xy` (F, 2) uT, levelled axes; NaN rows are left out. Single readings decide, so a wild one spoils it, and so
    does an end of the ellipse that no footfall reached.
    """
    return _find_by_extremes(level_xy, "by extremes", lambda x1, y1: half_turn(float(np.arctan2(y1, x1))))


def find_ellipse_as_printed(level_xy: Floats) -> Ellipse:
    """The same as the paper prints it: eta = asin(m_y1 / max r), mirrored where m_x1 < 0."""
    return _find_by_extremes(level_xy, "as printed", lambda x1, y1: float(np.arcsin(y1 / np.linalg.norm([x1, y1]))))


def _find_by_extremes(level_xy: Floats, method: str, find_eta: Callable[[float, float], float]) -> Ellipse:
    # centre, Ma (6): (max + min) / 2 of each axis
    readings = select_levelled(level_xy, 3)
    offset = (readings.max(axis=0) + readings.min(axis=0)) / 2
    centered = readings - offset
    # axes by the least and the greatest distance, Ma (7), (8)
    r = np.linalg.norm(centered, axis=1)
    eta, unknown = find_eta(*centered[np.argmax(r)]), np.full((4, 4), np.nan)
    found = Ellipse(method, offset, eta, float(r.min() / r.max()), float(r.min()), unknown, np.nan, len(centered))
    spread = np.linalg.norm(found.correct(readings), axis=1) - found.radius_uT
    return replace(found, residual_uT=float(np.sqrt((spread**2).mean())))


def measure_calibration(loops: Sequence[Arrays]) -> Measures:
    """Figures of Table 1 and Figure 7, over the loops; a method that refused a loop is infinitely wrong."""

    def known(values: Iterable[float]) -> Spread:
        return spread_of([float(value) if np.isfinite(value) else np.inf for value in values])

    def on_shoe(read: Callable[[Floats, Line], float]) -> Callable[[Line], dict[str, Spread]]:
        return lambda line: {
            column: known(read(loop[f"ellipse/{way}"], line) for loop in loops) for column, way in ON_SHOE.items()
        }

    def K(line: Line) -> dict[str, Spread]:  # no ellipsoid gives its scale from readings alone
        i, j = (int(index) for index in line.measure[1:])
        scaled = [loop["K"] * np.cbrt(np.linalg.det(MA_K) / np.linalg.det(loop["K"])) for loop in loops]
        return {"CLSEF": known(one[i, j] for one in scaled)}

    degrees = {column: [np.degrees(loop[f"heading/{way}"]) for loop in loops] for column, way in CALIBRATIONS.items()}
    largest = {
        column: np.array([np.abs(d).max() if len(d) else np.inf for d in some]) for column, some in degrees.items()
    }
    rms = {
        column: np.array([np.sqrt((d**2).mean()) if len(d) else np.inf for d in some])
        for column, some in degrees.items()
    }
    return {
        "offset": on_shoe(lambda shape, line: MG_PER_UT * shape[int(line.measure[1])]),
        "eta": on_shoe(lambda shape, _: shape[2]),
        "cosine": on_shoe(lambda shape, _: float(np.cos(shape[2]))),
        "sine": on_shoe(lambda shape, _: float(np.sin(shape[2]))),
        "tau": on_shoe(lambda shape, _: shape[3]),
        "B": lambda line: {"CLSEF": known(MG_PER_UT * loop["B_uT"][int(line.measure[1])] for loop in loops)},
        "K": K,
        "largest": lambda _: {column: spread_of(values.tolist()) for column, values in largest.items()},
        "rms": lambda _: {column: spread_of(values.tolist()) for column, values in rms.items()},
        "over_largest": lambda _: {
            column: spread_of((largest["CLSEF"] / largest[column]).tolist()) for column in ON_SHOE
        },
    }


# --- M-E2a: noise ----------------------------------------------------------------------------------------------------


def measure_noise(seed: int, rest_s: float) -> Arrays:
    """Sigmas of one seed (heading rad, inclination rad, strength uT); no rest where `rest_s` is zero."""
    found = {}
    walk = Simulated(OFFICE, "homogeneous", seed)
    for name, magnetometer in ((WALKED, LOOP), (IRON_ON, RAW)):
        try:
            prepared = walk.prepare(magnetometer)
        except CalibrationError:
            found[name] = np.full(3, np.inf)
            continue
        recording = prepared.sensed  # as it came, corrected by the loop at most
        assert recording is not None
        field = average_footfall_field(recording, detect_stances(recording))
        known = np.isfinite(field.strength)
        found[name] = _sigmas(field.heading_difference[known], field.inclination[known], field.strength[known])
    if rest_s:
        # sample by sample; the rate of a shoe at rest is no more than its bias, which the walk would take off
        still = replace(SCENARIOS["at-rest"], route=lambda rng: [Stand(rest_s)])
        rest = simulate(still, seed, Choices(sensor=SENSOR, rate_hz=100.0))
        mag = rest.mag[np.isfinite(rest.mag).all(axis=1)]
        level = rotate_to_level(mag, np.broadcast_to(np.nanmean(rest.recording.acc, axis=0), mag.shape))
        found[AT_REST] = _sigmas(compute_field_heading(level), compute_inclination(level), np.linalg.norm(mag, axis=1))
    return found


def _sigmas(heading: Floats, inclination: Floats, strength: Floats) -> Floats:
    """Standard deviations of the changes."""
    return np.array([np.std(wrap_angle(np.diff(heading))), np.std(np.diff(inclination)), np.std(np.diff(strength))])


def measure_sigma(noises: Sequence[Arrays], line: Line) -> dict[str, Spread]:
    """Sigma of one channel: heading, inclination, strength."""
    channel, scale = int(line.measure[1]), MG_PER_UT if line.unit == "mG" else 1.0
    return {
        column: spread_of([scale * float(noise[stored][channel]) for noise in noises if stored in noise])
        for column, stored in SIGMAS.items()
    }


# --- M-E2b: detections -----------------------------------------------------------------------------------------------


def measure_detections(name: str, seed: int) -> Arrays:
    """Simulate a walk and judge its F stances in each of the fields; arrays by field and name, with a slash.

    `vector_uT`, `course_deg` (F,) are true changes of the field's vector and of the course over the window, `wrong_deg`
    (F,) by how much a perfect compass is off, and `statistic DETECTOR` (F,) over its threshold.
    """
    arrays: dict[str, Floats] = {}
    for level in LIMIT_UT:
        # the same walk in each field, its iron removed as drawn
        walk = simulate(name, seed, Choices(field=level))
        recording, sensor, stances = walk.recording, walk.drawn["sensor"], detect_stances(walk.recording)
        mag = np.linalg.solve(np.array(sensor["soft_iron"]), (walk.mag - np.array(sensor["hard_iron_uT"])).T).T
        attitude = integrate_attitude(recording, stances)
        field = average_footfall_field(replace(recording, mag=mag), stances, nav_R_body=attitude)
        sample = stances.stillest(recording.gyr)
        nav_field = walk.nav_field(sample)
        # what is true of the stances, and what the detectors make of them
        arrays |= {
            f"{level}/vector_uT": measure_field_change(nav_field, WINDOW),
            f"{level}/course_deg": np.rad2deg(measure_course_change(walk.truth.position[sample], WINDOW)),
            f"{level}/wrong_deg": np.abs(np.rad2deg(measure_compass_deviation(nav_field, walk.earth.vector))),
        }
        arrays |= {f"{level}/statistic {detector}": judge_field(field, detector).statistic for detector in DETECTORS}
    return arrays


@dataclass(frozen=True)
class Case:
    """All walks in one field, as `measure_detections` leaves them: what is true of their M stances, and statistics."""

    field: str
    walks: Sequence[Arrays]

    def column(self, name: str) -> Floats:
        """(M,) of all walks."""
        return np.concatenate([walk[f"{self.field}/{name}"] for walk in self.walks])

    @cached_property
    def walk(self) -> Ints:
        """(M,) which walk a stance is of."""
        return np.repeat(np.arange(len(self.walks)), [len(walk[f"{self.field}/course_deg"]) for walk in self.walks])

    def statistic(self, detector: str) -> Floats:
        """(M,) over its threshold; NaN also where the truth is not known."""
        return np.where(np.isfinite(self.column("vector_uT")), self.column(f"statistic {detector}"), np.nan)

    def passes(self, detector: str) -> Bools:
        """(M,) True where the field passes; not where it was not judged."""
        return np.asarray(self.statistic(detector) < 1.0)

    def roc(self, detector: str) -> Roc | None:
        """ROC against the truth, by the field's own limit; None with too few of a kind."""
        statistic, static = self.statistic(detector), self.column("vector_uT") < LIMIT_UT[self.field]
        judged = np.isfinite(statistic)
        if min(static[judged].sum(), (~static)[judged].sum()) < FEWEST:
            return None
        return make_roc(statistic, static, self.walk)


def measure_roc(cases: Mapping[str, Case], line: Line) -> dict[str, Spread]:
    """By column; none where there are too few stances of a kind. What has a band over walks has it beside."""
    what, found = line.measure[0], {}
    for column, detector in JUDGED_BY.items():
        roc = cases[line.of].roc(detector)
        if roc is None:
            continue
        if what == "area":
            found[column] = roc.area_band()
        elif what in ("p_d", "p_fa"):
            found[column] = roc.band_at(1.0)[("p_d", "p_fa").index(what)]
        else:
            at = float(line.measure[1])
            value = find_slope(roc, at)
            if what == "bend":  # slope beyond the paper's knee over that before; of no walk where it is flat before
                before = find_slope(roc, at - 0.1)
                value = value / before if before > 0.0 else np.nan
            found[column] = Spread(value, value, value, 0 if np.isnan(value) else roc.n_walks)
    return found


def find_slope(roc: Roc, low: float) -> float:
    """dP_FA/dP_D between a P_D and the next tenth."""
    return float(np.diff(np.interp([low, low + 0.1], roc.p_d, roc.p_fa))[0] / 0.1)


def measure_wrong_where_it_passes(cases: Mapping[str, Case], line: Line) -> dict[str, Spread]:
    """Median over the footfalls of each walk of the error of a perfect compass."""
    case, found = cases[line.of], {}
    wrong_deg = case.column("wrong_deg")
    for column, detector in JUDGED_BY.items():
        passes = case.passes(detector)
        each = [wrong_deg[passes & (case.walk == walk)] for walk in range(len(case.walks))]
        found[column] = spread_of([float(np.nanmedian(wrong)) for wrong in each if len(wrong)])
    return found


def measure_over_straight(cases: Mapping[str, Case], line: Line) -> dict[str, Spread]:
    """Share of the footfalls on curves that pass, over that of those on straights, walk by walk (Figures 13, 14)."""
    case, found = cases[str(line.measure[1])], {}
    course_deg = case.column("course_deg")
    straight, curved = course_deg < STRAIGHT_DEG, course_deg >= CURVED_DEG
    for column, detector in ((PRINTED, f"{line.of}-printed"), (PHYSICAL, line.of)):
        passes, ratios = case.passes(detector), []
        for walk in range(len(case.walks)):
            on_curves, on_straights = (passes[part & (case.walk == walk)] for part in (curved, straight))
            if len(on_curves) and on_straights.any():
                ratios.append(float(on_curves.mean() / on_straights.mean()))
        found[column] = spread_of(ratios)
    return found


# --- M-E3, M-E4: besides figures of single walks ---------------------------------------------------------------------


def measure_end_at_heading(made: Made, line: Line) -> dict[str, Spread]:
    """Final position error in the office at a heading error in deg, on the line through our walks by least squares."""
    found = {}
    for column, method in made.table.filters[line.of].items():
        results = [one for one in made.of(OFFICE, line.level, method) if not one.failed]
        pairs = [(WALK_FIGURES["heading_deg"](one), WALK_FIGURES["end_m"](one)) for one in results]
        known = np.array([pair for pair in pairs if None not in pair], dtype=np.float64)
        found[column] = NOTHING
        if len(known) >= 2 and np.ptp(known[:, 0]) > 0.0:
            value = float(np.polynomial.Polynomial.fit(known[:, 0], known[:, 1], 1)(float(line.measure[1])))
            found[column] = Spread(value, value, value, len(known))
    return found


def measure_reduction(made: Made, line: Line) -> dict[str, Spread]:
    """By how much a figure of the mall is below that of the other filter in the same setting, walk by walk."""
    others, figure = made.table.filters[line.over], WALK_FIGURES[str(line.measure[1])]
    return {
        column: reduction_over(
            made.of(MALL, line.level, method),
            made.of(MALL, line.level, others[column if column in (PRINTED, PHYSICAL) else TUNED]),
            figure,
        )
        for column, method in made.table.filters[line.of].items()
    }


# --- Figures 7 and 8 -------------------------------------------------------------------------------------------------


def draw_headings(loop: Arrays) -> Figure:
    """Figure 7: magnetic less gyro heading of each calibration along the loop."""
    compared = {"CLSEF": "CLSEF", "proposed, as printed": PRINTED, "proposed, fitted": "fitted"}
    figure, [axes] = new_panels(1, 1, 3.4)
    axes.axhspan(-5.0, 5.0, color="#DCE9F2", zorder=0)
    for (label, column), colour in zip(compared.items(), palette.CYCLE[1::-1] + palette.CYCLE[2:], strict=False):
        heading = np.degrees(loop[f"heading/{CALIBRATIONS[column]}"])
        axes.plot(heading, ".-", color=colour, linewidth=0.8, markersize=3.0, label=label)
    axes.set(xlabel="footfall", ylabel="heading difference (deg)")
    axes.margins(x=0.01)
    style.head(axes, "Heading by the calibrated magnetometer less heading by the gyroscope")
    return figure


def draw_rocs(cases: Mapping[str, Case]) -> Figure:
    """Figure 8: ROC of the proposed detector, with 170 marked."""
    curves = [(case.roc(MA), f"{field}, {LIMIT_UT[field]:g} uT") for field, case in cases.items()]
    figure, [axes] = new_panels(1, 1, 4.6, 5.6)
    for (roc, label), colour in zip(curves, palette.CYCLE, strict=False):
        if roc is not None:
            axes.plot(roc.p_fa, roc.p_d, color=colour, label=label)
            axes.plot(*roc.at(1.0)[::-1], "o", color=colour, markersize=6.0, zorder=5, clip_on=False)
    ours = cases[BETWEEN].roc(OURS)
    if ours is not None:
        looks: dict[str, Any] = {
            "color": palette.CYCLE[1],
            "linestyle": (0, (4, 2)),
            "label": f"{BETWEEN}, physical",
        }
        axes.plot(ours.p_fa, ours.p_d, **looks)
    axes.plot([0, 1], [0, 1], color=style.SOFT_INK, linewidth=0.8, linestyle=(0, (2, 3)))
    axes.set(xlim=(-0.01, 1.01), ylim=(-0.01, 1.01), xlabel="probability of false alarm")
    axes.set(ylabel="probability of detection", box_aspect=1)
    style.head(axes, f"ROC, N = 3; dots: threshold {MA_THRESHOLD:g}", columns=2)
    return figure
