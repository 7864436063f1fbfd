"""Facts of the magnetic field that a walking foot meets, of a real walk or a simulated one: for `realism.py`.

Two sets of facts. `FACTS`: the gdin walks as the sensor reads. `FLOOR_FACTS`: walks of four sets, the magnetometer
corrected by the walk itself and the attitude of the smoother, beside simulated buildings about the very same paths
(`FloorWalk.draw_building`), so that length, corners and strides are equal. The smoother leans on the field: what is
alike for a hundred metres is a little less on real walks than it was.

As the sensor reads:

Footfalls, attitude and path are those of the IEZ filter, which does not use the magnetometer. A real sensor's hard iron
turns with the foot: it widens the spreads and not the steps along a straight. It also answers late (the GX5 by 20 to
25 ms, in each of the ten walks), which in a swing of 400 deg/s looks like 6 uT of roughness. The delay at which the
field in nav is smoothest along the path is found first, and removed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import walks

from fg_nav.arrays import Floats, Ints
from fg_nav.detection import detect_stances
from fg_nav.detection.stance import Stances
from fg_nav.ekf import run_iez
from fg_nav.errors import RecordingError
from fg_nav.io import read
from fg_nav.lab.simulation.fields import SITES, draw_environment
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.solution import Solution
from fg_nav.walk import Options, read_walk

WALKED_M = 0.5  # A footfall less than this from the one before is the same standing foot.
LAGS = (1, 2, 3, 5)  # Strides apart.
DISTANCES_M = (0.1, 0.3)  # Along the path, within one swing.
SHORT = "variogram_10cm"  # The fact that is least at the right delay.
DELAYS_S = (0.0, 0.04)  # Delays of a magnetometer that are tried, sample by sample.

NEAR_UT = 2.0

MIN_PAIRS = 8  # Of footfalls, for a correlation.
NOTHING_UT2 = 1e-12  # A variance below this is rounding.


FACTS: Mapping[str, tuple[str, str]] = {
    "norm_sd_uT": ("|m|, sd (uT)", "{:.1f}"),
    "norm_spread_uT": ("|m|, 5 to 95 % (uT)", "{:.1f}"),
    "deviation_uT": ("deviation from the mean, rms per axis (uT)", "{:.1f}"),
    "step_uT": ("change of the vector from footfall to footfall, median (uT)", "{:.1f}"),
    "step_90_uT": ("the same, 90 % (uT)", "{:.1f}"),
    "compass_sd_deg": ("compass minus inertial heading, circular sd (deg)", "{:.1f}"),
    "near_share": ("|m| within 2 uT of the median vector's", "{:.2f}"),
    "excess_kurtosis": ("excess kurtosis of the deviation", "{:.1f}"),
    **{f"correlation_{lag}": (f"correlation of the deviation, {lag} strides apart", "{:.2f}") for lag in LAGS},
    **{
        f"variogram_{100 * d:.0f}cm": (
            f"half the square of the change over {100 * d:.0f} cm, of the variance",
            "{:.2f}",
        )
        for d in DISTANCES_M
    },
    "steadiness_uT": ("sd within a stance, median (uT)", "{:.2f}"),
    "delay_ms": ("delay of the magnetometer (ms)", "{:.0f}"),
}
"""Of each fact: what it is, and how it is written."""


@dataclass(frozen=True)
class Sensed:
    """A walk with its magnetometer, and how an estimator saw it."""

    name: str
    recording: Recording
    stances: Stances
    solution: Solution

    def facts(self) -> dict[str, float]:
        """Facts of its field."""
        return field_facts(self.recording, self.stances, self.solution)


def field_facts(recording: Recording, stances: Stances, solution: Solution) -> dict[str, float]:
    """Facts about the field that a walk felt, in nav as the solution's attitude has it.

    Parameters
    ----------
    recording : with a magnetometer, in the body frame; its rows may be NaN where there was no sample.
    stances, solution : of that recording.

    Returns
    -------
    dict
        The keys of `FACTS`; units in the names. Footfalls are those of walking: a foot that stays counts once.

    Raises
    ------
    RecordingError
        Without a magnetometer, or with too few strides.
    """
    nav_field, delay_s = _nav_field(recording, solution)
    felt = nav_field[_footfalls(recording, stances, solution, nav_field)]
    return {
        **_spread(felt),
        **_rhythm(felt),
        **_variogram(solution.position, nav_field),
        "steadiness_uT": _steadiness(stances, nav_field),
        "delay_ms": 1000 * delay_s,
    }


def _nav_field(recording: Recording, solution: Solution) -> tuple[Floats, float]:
    """Field (N, 3) in nav when it was felt, and the delay in s by which the magnetometer lags."""
    if recording.mag is None:
        raise RecordingError("the recording has no magnetometer: take one that has.")
    first, last = (round(delay / recording.period_s) for delay in DELAYS_S)
    fields = {n: _advanced(recording.mag, solution.nav_R_body, n) for n in range(first, last + 1)}
    rough = {n: _variogram(solution.position, field)[SHORT] for n, field in fields.items()}
    best = min(rough, key=lambda n: (rough[n], abs(n)))
    return fields[best], best * recording.period_s


def _advanced(mag: Floats, nav_R_body: Floats, samples: int) -> Floats:
    """Field (N, 3) in nav of a magnetometer whose rows come so many samples late; NaN where there is none."""
    early = np.full_like(mag, np.nan)
    there = slice(max(0, -samples), len(mag) - max(0, samples))
    early[there] = mag[max(0, samples) : len(mag) - max(0, -samples)]
    field: Floats = np.einsum("nij,nj->ni", nav_R_body, early)
    return field


def _footfalls(recording: Recording, stances: Stances, solution: Solution, nav_field: Floats) -> Ints:
    """Samples with a field nearest to the stillest of each footfall, each some way from the one before."""
    known = np.flatnonzero(np.isfinite(nav_field).all(axis=1))
    stillest = stances.stillest(recording.gyr)
    after = np.clip(np.searchsorted(known, stillest), 1, len(known) - 1)
    earlier = stillest - known[after - 1] < known[after] - stillest
    sample = known[after - earlier]
    kept = [int(sample[0])]
    for i in sample[1:]:
        if np.linalg.norm(solution.position[i, :2] - solution.position[kept[-1], :2]) > WALKED_M:
            kept.append(int(i))
    if len(kept) < 2 * max(LAGS):
        raise RecordingError(f"{len(kept)} footfalls say little about a field: take a walk of {2 * max(LAGS)} or more.")
    return np.array(kept)


def _spread(felt: Floats) -> dict[str, float]:
    norm = np.linalg.norm(felt, axis=1)
    low, high = np.percentile(norm, [5, 95])
    deviation = felt - felt.mean(axis=0)
    resultant = np.abs(np.mean(np.exp(1j * np.arctan2(felt[:, 0], felt[:, 1]))))
    middle = np.linalg.norm(np.median(felt, axis=0))
    return {
        "norm_sd_uT": float(norm.std()),
        "norm_spread_uT": float(high - low),
        "deviation_uT": float(np.sqrt(np.mean(deviation**2))),
        "compass_sd_deg": float(np.rad2deg(np.sqrt(-2 * np.log(resultant)))),
        "near_share": float(np.mean(np.abs(norm - middle) < NEAR_UT)),
        "excess_kurtosis": _excess_kurtosis(deviation),
    }


def _excess_kurtosis(deviation: Floats) -> float:
    """Mean over the axes; that of a field which does not change is 0."""
    square, fourth = np.mean(deviation**2, axis=0), np.mean(deviation**4, axis=0)
    changes = square > NOTHING_UT2
    return float(np.mean(np.divide(fourth, square**2, out=np.full_like(square, 3.0), where=changes)) - 3)


def _rhythm(felt: Floats) -> dict[str, float]:
    """From footfall to footfall."""
    deviation = felt - felt.mean(axis=0)
    power = max(float(np.mean(np.sum(deviation**2, axis=1))), NOTHING_UT2)
    step = np.linalg.norm(np.diff(felt, axis=0), axis=1)
    pairs = {lag: np.mean(np.sum(deviation[lag:] * deviation[:-lag], axis=1)) for lag in LAGS}
    return {
        "step_uT": float(np.median(step)),
        "step_90_uT": float(np.percentile(step, 90)),
        **{f"correlation_{lag}": float(product / power) for lag, product in pairs.items()},
    }


def _variogram(position: Floats, nav_field: Floats, spacing_m: float = 0.02) -> dict[str, float]:
    """Of the field along the path over the ground, the swings too."""
    known = np.isfinite(nav_field).all(axis=1)
    path, field = position[known, :2], nav_field[known]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    asked = np.arange(0.0, along[-1], spacing_m)
    even = np.stack([np.interp(asked, along, field[:, i]) for i in range(3)], axis=1)
    power = max(2 * float(np.sum(even.var(axis=0))), NOTHING_UT2)
    lags = {d: round(d / spacing_m) for d in DISTANCES_M}
    change = {d: np.mean(np.sum((even[lag:] - even[:-lag]) ** 2, axis=1)) for d, lag in lags.items()}
    return {f"variogram_{100 * d:.0f}cm": float(value / power) for d, value in change.items()}


def _steadiness(stances: Stances, nav_field: Floats, fewest: int = 5) -> float:
    """Root of the mean variance of the three axes over a stance; the median over stances."""
    known = [nav_field[start:stop] for start, stop in zip(stances.start, stances.stop, strict=True)]
    finite = [field[np.isfinite(field).all(axis=1)] for field in known]
    return float(np.median([np.sqrt(field.var(axis=0).mean()) for field in finite if len(field) >= fewest]))


def read_walks(data: Path, numbers: Sequence[int] = walks.GDIN_WALKS) -> list[Sensed]:
    """Load the gdin walks with their magnetometer."""
    return [_with_magnetometer(one.read()) for one in walks.list_set(data, walks.GDIN) if int(one.name[5:]) in numbers]


def sense_walk(recording: Recording) -> Sensed:
    """Find stances and attitude of a recording as of a real walk."""
    stances = detect_stances(recording)
    return Sensed(recording.provenance.format, recording, stances, run_iez(recording, stances))


def _with_magnetometer(walk: walks.Walk) -> Sensed:
    path = walk.recording.provenance.path
    assert path is not None
    return Sensed(walk.name, read(path), walk.stances, run_iez(walk.recording, walk.stances))


# --- floors ----------------------------------------------------------------------------------------------------------

STRIDES_APART = (1, 2, 4, 8, 16)  # Lags of the correlation.
LEG, MIN_LEGS = 32, 3  # Footfalls of a leg, some 45 m, and legs of a walk.

FLOOR_FACTS: Mapping[str, tuple[str, str]] = {
    "level_sd_uT": ("sd per axis over ground (uT)", "{:.1f}"),
    "up_sd_uT": ("sd of the vertical (uT)", "{:.1f}"),
    "level_kurtosis": ("excess kurtosis over ground", "{:.1f}"),
    **{f"level_correlation_{lag}": (f"correlation, {lag} strides apart", "{:.2f}") for lag in STRIDES_APART},
    "leg_sd_ratio": (f"sd of the mean of {LEG} strides / at the footfalls", "{:.2f}"),
    "path_sd_ratio": ("sd of the mean along a stride / at the footfalls", "{:.2f}"),
    "path_correlation_1": ("correlation of the mean along a stride, 1 stride apart", "{:.2f}"),
    "potential_m": ("sd of the potential / of the field (m)", "{:.1f}"),
    "potential_change_5": ("change of the potential over 5 strides, rms / sd", "{:.2f}"),
}
"""Of each fact of a floor: what it is, and how it is written. Horizontal field, deviations from the walk's mean."""

FLOORS: Mapping[str, Sequence[str]] = {
    "gdin": tuple(f"gdin/own/SensorConnectData_{n}.csv" for n in (31, 33, 36, 40))
    + tuple(f"gdin/own_obsolete/SensorConnectData_{n}.csv" for n in (15, 18, 20, 22, 24, 29)),
    "openshoe": tuple(f"openshoe/data_inert{n}.txt" for n in (1, 7, 13)),
    "mtig710": ("mtig710/2022_1_14_hallway_walk3.csv.gz", "mtig710/2022_1_13_straight_walk_foot1.csv.gz"),
    "mems_foot": tuple(f"mems_foot/lap_360m_{n}.csv.gz" for n in (1, 2, 3)),
}
"""Walks on one floor of a building, by set; the squares and lines of mems_foot, sd 1 uT, have no floor of steel."""

SENSOR_HEIGHT_M = 0.1  # Of a standing foot's sensor.
SAMPLES_A_STRIDE = 60  # Places on a path at which a drawn field is asked for.


@dataclass(frozen=True)
class FloorWalk:
    """A path and the field along it.

    Attributes
    ----------
    group, name : set and walk.
    position : (N, 3) m in nav.
    nav_field : (N, 3) uT, NaN where there is no sample.
    footfall : (K,) samples.
    """

    group: str
    name: str
    position: Floats
    nav_field: Floats
    footfall: Ints

    def facts(self) -> dict[str, float]:
        """Facts of its floor: the keys of `FLOOR_FACTS`."""
        felt = self.nav_field[self.footfall]
        level = felt[:, :2] - felt[:, :2].mean(axis=0)
        mean, potential = self._sum_strides()
        mean -= mean.mean(axis=0)
        sd, potential_sd = float(np.sqrt(np.mean(level**2))), float(potential.std())
        change = potential[5:] - potential[:-5]
        return {
            "level_sd_uT": sd,
            "up_sd_uT": float(felt[:, 2].std()),
            "level_kurtosis": _excess_kurtosis(level),
            **{f"level_correlation_{lag}": _correlation(level, lag) for lag in STRIDES_APART},
            "leg_sd_ratio": _leg_sd(level) / sd,
            "path_sd_ratio": float(np.sqrt(np.mean(mean**2))) / sd,
            "path_correlation_1": _correlation(mean, 1),
            "potential_m": potential_sd / sd,
            "potential_change_5": float(np.sqrt(np.mean(change**2))) / potential_sd,
        }

    def _sum_strides(self) -> tuple[Floats, Floats]:
        """Mean horizontal field along each stride (K - 1, 2) uT, and the potential (K,) uT m at the footfalls."""
        known = np.flatnonzero(np.isfinite(self.nav_field).all(axis=1))
        field, place = self.nav_field[known], self.position[known]
        step, middle = np.diff(place, axis=0), (field[1:] + field[:-1]) / 2
        length = np.linalg.norm(step[:, :2], axis=1)
        sums = np.cumsum(np.column_stack([middle[:, :2] * length[:, None], length, np.sum(middle * step, axis=1)]), 0)
        at = np.vstack([np.zeros(4), sums])[np.searchsorted(known, self.footfall)]
        walked = np.diff(at, axis=0)
        # without the homogeneous field
        homogeneous = np.column_stack([self.position[self.footfall], np.ones(len(at))])
        potential = at[:, 3] - homogeneous @ np.linalg.lstsq(homogeneous, at[:, 3], rcond=None)[0]
        return walked[:, :2] / walked[:, 2:3], potential

    def draw_building(self, level: str, seed: int) -> FloorWalk:
        """The same path over a simulated floor, the foot as high over it as it was lifted."""
        skip = max(1, len(self.position) // (SAMPLES_A_STRIDE * len(self.footfall)))
        every = np.union1d(np.arange(0, len(self.position), skip), self.footfall)
        place = self.position[every]
        rises = np.interp(every, self.footfall, self.position[self.footfall, 2])
        place = np.column_stack([place[:, :2], SENSOR_HEIGHT_M + np.maximum(place[:, 2] - rises, 0.0)])
        at = np.searchsorted(every, self.footfall)
        points = place[at] * [1.0, 1.0, 0.0]
        field = draw_environment(level, SITES["munich"], points, np.random.default_rng(seed))
        return FloorWalk(self.group, self.name, place, field.at(place), at)


def _correlation(deviation: Floats, lag: int) -> float:
    """Over both axes; NaN on a walk of few more strides than the lag."""
    if len(deviation) < lag + MIN_PAIRS:
        return float("nan")
    return float(np.mean(deviation[lag:] * deviation[:-lag]) / np.mean(deviation**2))


def _leg_sd(deviation: Floats) -> float:
    """Standard deviation per axis of the means of legs; NaN on a walk of few."""
    count = len(deviation) // LEG
    if count < MIN_LEGS:
        return float("nan")
    legs = deviation[: count * LEG].reshape(count, LEG, -1).mean(axis=1)
    return float(np.sqrt(np.mean((legs - legs.mean(axis=0)) ** 2)))


def read_floor(group: str, path: Path) -> FloorWalk:
    """A walk as the smoother has it, its magnetometer corrected by the walk itself."""
    walk = prepare_walk(read_walk(path, Options()))
    solution = run_method(walk, "smoother").solution
    return make_floor_walk(group, path.name.split(".")[0], walk.recording, walk.stances, solution)


def make_floor_walk(group: str, name: str, recording: Recording, stances: Stances, solution: Solution) -> FloorWalk:
    """The field along a solved path."""
    nav_field, _ = _nav_field(recording, solution)
    footfall = _footfalls(recording, stances, solution, nav_field)
    return FloorWalk(group, name, solution.position, nav_field, footfall)


def read_floors(data: Path, sets: Mapping[str, Sequence[str]] = FLOORS) -> list[FloorWalk]:
    """Walks of all sets, some minutes in all."""
    return [read_floor(group, data / name) for group, names in sets.items() for name in names]


def middle_by_set(floors: Sequence[FloorWalk]) -> dict[str, dict[str, float]]:
    """Median facts of the walks of each set; NaN where none of its walks is long enough."""
    found: dict[str, list[dict[str, float]]] = {}
    for one in floors:
        found.setdefault(one.group, []).append(one.facts())
    return {group: {key: nan_median([f[key] for f in some]) for key in FLOOR_FACTS} for group, some in found.items()}


def nan_median(values: Sequence[float]) -> float:
    """Median of the finite values; NaN without one."""
    finite = [value for value in values if np.isfinite(value)]
    return float(np.median(finite)) if finite else float("nan")
