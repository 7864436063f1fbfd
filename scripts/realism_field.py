"""Whether the simulated field is as unforgiving as a real floor: the same facts of both, side by side.

    python scripts/realism_field.py [--data DIR] [--seeds N] [--per-walk]

Real: the ten gdin walks, indoors, 35 to 150 m, magnetometer on the foot, attitude and path of the IEZ filter (which
does not use it). Simulated, at Munich:

================= ===================================================================================================
same paths        the level `indoor` put under the ten real paths: their strides, foot heights, drift and stances; a
                  building each
corridor          `indoor` on a made-up walk: strides of 1.29 m, right-angled corners, 80 strides, sensor at 0.10 m on
                  the standing foot; N buildings
smooth            the level `smooth` on such walks
================= ===================================================================================================

What the real sensor adds:

* its own hard iron turns with the foot: it widens the real spreads and not the steps along a straight. Its horizontal
  part shows in walks that turn, and the second column has it taken off (ridge fit, prior 5 uT per axis); its vertical
  part is a constant;
* it answers late (the GX5 by 20 to 25 ms, in each of the ten walks), which in a swing of 400 deg/s looks like 6 uT of
  roughness. The delay at which the field in nav is smoothest along the path is found first, printed, and removed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import harness
import numpy as np
import walks

from fg_nav.arrays import Floats, Ints
from fg_nav.detection import detect_stances
from fg_nav.ekf import run_iez
from fg_nav.errors import RecordingError
from fg_nav.frames import GRAVITY_M_S2, yaw_rotation
from fg_nav.io import read
from fg_nav.lab.simulation.fields import SITES, draw_environment
from fg_nav.recording import Recording
from fg_nav.solution import Solution, StanceTable
from fg_nav.stances import Stances

WALKED_M = 0.5
"""A footfall less than this from the one before is the same standing foot."""

LAGS = (1, 2, 3, 5)
"""Strides apart."""

DISTANCES_M = (0.1, 0.3)
"""Along the path, within one swing."""

SHORT = "variogram_10cm"
"""The fact that is least at the right delay."""

DELAYS_S = (0.0, 0.04)
"""Delays of a magnetometer that are tried, sample by sample."""

NEAR_UT = 2.0

NOTHING_UT2 = 1e-12
"""A variance below this is rounding."""

EARTH = SITES["munich"]

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


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(__doc__, arguments, data=None, seeds=20, per_walk=False)
    real = real_walks(walks.data_folder(chosen.data))
    seeds = range(chosen.seeds)
    columns = {
        "real": [walk.facts() for walk in real],
        "less hard iron": [without_hard_iron(walk).facts() for walk in real],
        "same paths": [on_path(walk, k).facts() for k, walk in enumerate(real)],
        "corridor": [corridor("indoor", seed).facts() for seed in seeds],
        "smooth": [corridor("smooth", seed).facts() for seed in seeds],
    }
    harness.print_heading("The field at the foot: median [least, most] over walks")
    rows = [[words, *(spread_words(of, key, form) for of in columns.values())] for key, (words, form) in FACTS.items()]
    harness.print_table(("fact", *columns), rows)
    if chosen.per_walk:
        single = [[words, *(form.format(f[key]) for f in columns["real"])] for key, (words, form) in FACTS.items()]
        harness.print_heading("Each real walk")
        harness.print_table(("fact", *(walk.name for walk in real)), single)


def spread_words(facts: Sequence[Mapping[str, float]], key: str, form: str) -> str:
    """Median, least and most of a fact over walks."""
    values = [fact[key] for fact in facts]
    middle, least, most = (form.format(f(values)) for f in (np.median, np.min, np.max))
    return f"{middle} [{least}, {most}]"


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
    return float(np.mean(np.divide(fourth, square**2, out=np.full(3, 3.0), where=changes)) - 3)


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


def real_walks(data: Path, numbers: Sequence[int] = walks.GDIN_WALKS) -> list[Sensed]:
    """Load the gdin walks with their magnetometer."""
    return [_with_magnetometer(walk) for walk in walks.read_gdin(data, numbers)]


def sensed(recording: Recording) -> Sensed:
    """Find stances and attitude of a recording as of a real walk."""
    stances = detect_stances(recording)
    return Sensed(recording.provenance.format, recording, stances, run_iez(recording, stances))


def _with_magnetometer(walk: walks.Walk) -> Sensed:
    path = walk.recording.provenance.path
    assert path is not None
    return Sensed(walk.name, read(path), walk.stances, run_iez(walk.recording, walk.stances))


def without_hard_iron(walk: Sensed, prior_uT: float = 5.0) -> Sensed:
    """Take off what turns with the foot: nav_field = B + nav_R_body (h_x, h_y, 0) over the footfalls."""
    nav_field, _ = _nav_field(walk.recording, walk.solution)
    stood = _footfalls(walk.recording, walk.stances, walk.solution, nav_field)
    turning = walk.solution.nav_R_body[stood][:, :, :2]
    felt = nav_field[stood] - nav_field[stood].mean(axis=0)
    turning = turning - turning.mean(axis=0)
    noise = np.mean(felt**2)
    normal = np.einsum("nij,nik->jk", turning, turning) / noise + np.eye(2) / prior_uT**2
    h = np.linalg.solve(normal, np.einsum("nij,ni->j", turning, felt) / noise)
    assert walk.recording.mag is not None
    return replace(walk, recording=replace(walk.recording, mag=walk.recording.mag - [*h, 0.0]))


def on_path(walk: Sensed, seed: int, level: str = "indoor") -> Sensed:
    """Put a simulated building under a real path, levelled from footfall to footfall."""
    solution, t = walk.solution, walk.recording.t
    stood = walk.stances.stillest(walk.recording.gyr)
    position = solution.position.copy()
    position[:, 2] += 0.1 - np.interp(t, t[stood], position[stood, 2])
    floor = position[stood] * [1.0, 1.0, 0.0]
    field = draw_environment(level, EARTH, floor, np.random.default_rng(seed)).at(position)
    return replace(walk, recording=replace(walk.recording, mag=_body(field, solution.nav_R_body)))


def corridor(level: str, seed: int, strides: int = 80) -> Sensed:
    """Walk through a made-up corridor with right-angled corners: what the foot truly passes, without any noise."""
    rng = np.random.default_rng(seed)
    footprint, heading = _corridor(rng, strides)
    field = draw_environment(level, EARTH, footprint * [1.0, 1.0, 0.0], rng)
    t, position, phase = _foot(footprint)
    nav_R_body = np.repeat([yaw_rotation(np.pi / 2 - angle) for angle in heading], SAMPLES, axis=0)
    stances = Stances.from_mask(np.tile(phase < STANCE_SHARE, len(footprint)))
    recording = Recording(
        t=t,
        acc=np.tile([0.0, 0.0, GRAVITY_M_S2], (len(t), 1)),
        gyr=np.zeros((len(t), 3)),
        mag=_body(field.at(position), nav_R_body),
    )
    return Sensed(f"{level} {seed}", recording, stances, _truth(t, position, nav_R_body, stances))


SAMPLES = 93
"""Of a stride of 0.93 s."""

STANCE_SHARE, STRIDE_M, SWING_RISE_M, ROLL_M = 0.4, 1.29, 0.12, 0.003


def _corridor(rng: np.random.Generator, strides: int, straight: int = 9) -> tuple[Floats, Floats]:
    """Footprints (K, 3) m at the sensor's height and headings (K,) rad."""
    turns = np.where(np.arange(strides) % straight == straight - 1, rng.choice([-1, 1], strides) * np.pi / 2, 0.0)
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(turns)
    step = STRIDE_M * (1 + 0.03 * rng.standard_normal(strides))
    xy = np.cumsum(step[:, None] * np.stack([np.sin(heading), np.cos(heading)], axis=1), axis=0)
    return np.column_stack([xy, np.full(strides, 0.1)]), heading


def _foot(footprint: Floats) -> tuple[Floats, Floats, Floats]:
    """Stamps and positions of the samples, and the phase (SAMPLES,) of a stride: it stands, then swings."""
    phase = np.arange(SAMPLES) / SAMPLES
    u = np.clip((phase - STANCE_SHARE) / (1 - STANCE_SHARE), 0, 1)
    way = np.diff(footprint, axis=0, append=footprint[-1:])
    gone = u**2 * (3 - 2 * u) + ROLL_M / STRIDE_M * np.minimum(phase / STANCE_SHARE, 1) * (1 - u)
    position = footprint[:, None] + gone[:, None] * way[:, None]
    position[:, :, 2] += SWING_RISE_M * np.sin(np.pi * u) ** 2
    return 0.01 * np.arange(len(footprint) * SAMPLES), position.reshape(-1, 3), phase


def _body(nav_field: Floats, nav_R_body: Floats) -> Floats:
    return np.asarray(np.einsum("nji,nj->ni", nav_R_body, nav_field))


def _truth(t: Floats, position: Floats, nav_R_body: Floats, stances: Stances) -> Solution:
    """Return the truth as if an estimator had found it."""
    row = stances.start
    none = np.zeros((len(row), 3))
    table = StanceTable(
        sample=row,
        t=t[row],
        position=position[row],
        nav_R_body=nav_R_body[row],
        gyro_bias=none,
        position_cov=np.zeros((len(row), 3, 3)),
        heading_sigma=none[:, 0],
        gyro_bias_sigma=none,
        field=("none",) * len(row),
        field_reason=("",) * len(row),
    )
    return Solution("truth", t, position, np.gradient(position, t, axis=0), nav_R_body, table, runtime_s=0.0)


if __name__ == "__main__":
    harness.run(main)
