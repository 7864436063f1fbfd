"""What the integral of the field along the way leaves over: on simulated walks, and on the gdin and openshoe walks.

    python scripts/field_potential.py [--seeds N] [--scenarios NAME ...] [--trajectory true|own|upright] [--no-real]

The integral u of the body field over the displacements of the body frame is E . p + h . s less the potential phi
(`factors.magnetic_field`). E (east, north), h and a constant are fitted to u at the footfalls by least squares; h has
a prior of 15 uT. What is left over is phi, rms in uT m; over |E| it is how well the field shows the coordinate along
magnetic north at any footfall, however far one has walked.

Simulated walks: along the true trajectory. With `--trajectory own` the field is summed along that of the smoother
without magnetometer, heading drift and all, and E is fitted to the true places; `upright` is the same with true tilt.
Median [5 %, 95 %] over the seeds, which begin at 101. `E` is over the true one, `direction` is against the true one;
`iron` is what the fit makes of h, along the way, per metre; `correlation` of phi with itself 1, 4 and 16 strides on.
`compass` is the spread of the field's direction at the footfalls; `p` is that of `shuffled`, below, in pieces of 60
strides.

Real walks: along the trajectory of the smoother without magnetometer, the magnetometer as it reads. `direction` is
against the mean field at the footfalls. `stance` is the strength of that mean. Controls:

=========== ========================================================================================================
shuffled    what the strides leave over, in random order: E and h are fitted again. Errors that do not telescope leave
            as much in any order. p is the share of orders that leave no more than the true one
shifted     the strides' deviations from the mean field, in the navigation frame, go to the strides some way on
            (between a quarter and three quarters of the walk, round the end): the field is as rough, but not that of
            the way. Median
strange     the same with the field in the body frame: |E| found from fields that belong to other headings
=========== ========================================================================================================

Places passed twice: footfalls within 0.5 m of each other, more than 5 strides apart. By how much phi differs, rms:
`anywhere` from one footfall to another, `there` between these. `tied` is what is left over, `there` and
`iron` where the fit assumes that phi is the same there to 1 uT m: without curl this costs little. `shifted` as above,
and tied.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import harness
import numpy as np
import walks
from harness import option, spread

from fg_nav.arrays import Floats, Ints
from fg_nav.factors.magnetic_field import integrate_field
from fg_nav.factors.rotation import rotation_exp, turn_about_up
from fg_nav.frames import wrap_angle
from fg_nav.lab.campaign.walks import LOOP, RAW, Recorded, Simulated
from fg_nav.lab.field_survey import require_field
from fg_nav.lab.simulation import scenario
from fg_nav.lab.simulation.fields import find_earth_field
from fg_nav.smoother import smooth
from fg_nav.truth import TrajectoryTruth
from fg_nav.walk import Walk

SCENARIOS = ("mall", "office", "teaching-building")
LEVELS = ("smooth", "indoor")
LAGS = (1, 4, 16)
TRAJECTORIES = TRUE, OWN, UPRIGHT = "true", "own", "upright"

IRON_SIGMA_UT, PHI_SIGMA_UT_M = 15.0, 5.0
"""Priors of the fit: iron of an uncalibrated shoe, and a rough floor's potential."""

AGAIN_M, AGAIN_STRIDES, AGAIN_UT_M = 0.5, 5, 1.0
"""A place passed twice: so near, after so many strides, and how nearly phi is the same there."""

MIN_PLACES = 3  # One pair alone is always made to agree, by the iron along the way.

SHUFFLES, SHIFTS, PIECE, PIECE_SHUFFLES = 500, 9, 60, 50


@dataclass(frozen=True)
class Trajectory:
    """Of all samples of a recording: `nav_R_body` (N, 3, 3), `position` (N, 3) m."""

    nav_R_body: Floats
    position: Floats


@dataclass(frozen=True)
class Way:
    """A walk as the field and a trajectory have it: all its samples, and the integrals at its F footfalls."""

    t: Floats
    body_field: Floats
    trajectory: Trajectory
    footfall: Ints
    u: Floats
    s: Floats
    stance_field: Floats
    """(F, 3) uT, at the footfalls in nav."""

    @property
    def position(self) -> Floats:
        """(F, 3) m of the footfalls, from the first."""
        p = self.trajectory.position[self.footfall]
        return np.asarray(p - p[0])

    @property
    def length_m(self) -> float:
        """Footfall by footfall over the ground."""
        return float(np.linalg.norm(np.diff(self.position[:, :2], axis=0), axis=1).sum())

    def piece(self, start: int, stop: int) -> Way:
        """From one footfall to before another; all samples stay."""
        part = slice(start, stop)
        u, s = self.u[part], self.s[part]
        return replace(self, footfall=self.footfall[part], u=u - u[0], s=s - s[0])

    def passed_twice(self) -> tuple[Ints, Ints]:
        """Footfalls (M,) and (M,) of the same places."""
        place = self.position[:, :2]
        apart = np.linalg.norm(place[:, None] - place, axis=2)
        first, again = np.nonzero(np.triu(apart < AGAIN_M, AGAIN_STRIDES + 1))
        return first, again


@dataclass(frozen=True)
class Fit:
    """E (2,) uT, h (3,) uT, and what is left over of u at each footfall (F,) uT m."""

    earth: Floats
    iron: Floats
    left: Floats

    @property
    def strength(self) -> float:
        """|E|, uT."""
        return float(np.hypot(*self.earth))

    @property
    def rms(self) -> float:
        """Of what is left over, uT m."""
        return float(np.sqrt(np.mean(self.left**2)))

    @property
    def rms_m(self) -> float:
        """The same as metres towards magnetic north."""
        return self.rms / self.strength

    def correlation(self, lag: int) -> float:
        """Of what is left over with itself so many strides on."""
        return float(np.mean(self.left[lag:] * self.left[:-lag]) / np.mean(self.left**2))

    def iron_along(self, way: Way) -> float:
        """What h adds to u in a metre, uT."""
        return float(self.iron @ (way.s[-1] - way.s[0]) / way.length_m)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        seeds=10,
        scenarios=SCENARIOS,
        magnetometer=option(LOOP, "what is known of the iron", choices=("perfect", "loop", "raw")),
        trajectory=option(TRUE, "to sum the field along", choices=TRAJECTORIES),
        jobs=2,
        data=None,
        no_real=option(False, "simulated walks only"),
        walks=None,
    )
    print_simulated(chosen)
    if not chosen.no_real:
        print_real(walks.data_folder(chosen.data), chosen.walks)


def way_of(walk: Walk, trajectory: Trajectory) -> Way:
    """Sum the field of a walk along a trajectory."""
    recording, field = walk.recording, require_field(walk)
    assert recording.mag is not None
    seen = np.isfinite(field.body_field[:, 0])
    stance_field = np.einsum("kab,kb->ka", trajectory.nav_R_body[field.sample], field.body_field)[seen]
    blank = Way(recording.t, recording.mag, trajectory, field.sample, np.zeros(0), np.zeros((0, 3)), stance_field)
    return summed(blank, recording.mag)


def summed(way: Way, body_field: Floats) -> Way:
    """Return the way with the integrals of another field."""
    where, instants = way.trajectory, way.t[way.footfall]
    vertical = float(np.median(way.stance_field[:, 2]))
    found = integrate_field(way.t, where.nav_R_body, where.position, body_field, instants, vertical)
    return replace(way, body_field=body_field, u=found.u - found.u[0], s=found.s - found.s[0])


def fitted(way: Way, tied: bool = False) -> Fit:
    """E, h and a constant by least squares; with `tied`, places passed twice have one phi."""
    columns = np.column_stack([way.position[:, :2], way.s, np.ones(len(way.u))])
    prior = np.hstack([np.zeros((3, 2)), np.eye(3), np.zeros((3, 1))]) * PHI_SIGMA_UT_M / IRON_SIGMA_UT
    rows, right = [columns, prior], [way.u, np.zeros(3)]
    if tied:
        first, again = way.passed_twice()
        weight = PHI_SIGMA_UT_M / AGAIN_UT_M
        rows.append(weight * (columns[again] - columns[first]))
        right.append(weight * (way.u[again] - way.u[first]))
    x = np.linalg.lstsq(np.vstack(rows), np.concatenate(right))[0]
    return Fit(earth=x[:2], iron=x[2:5], left=way.u - columns @ x)


def towards(nav_field: Floats) -> float:
    """Degrees clockwise from north of a field (..., 2 or 3)."""
    return float(np.degrees(np.arctan2(nav_field[0], nav_field[1])))


def print_simulated(chosen: argparse.Namespace) -> None:
    """One row a scenario and field."""
    rows = []
    for name in chosen.scenarios if chosen.seeds else ():
        for level in LEVELS:
            measure = partial(of_seed, name, level, chosen.magnetometer, chosen.trajectory)
            found = harness.map_walks(measure, harness.seeds_of(chosen), chosen.jobs, f"{name}, {level}")
            rows.append([f"{name}, {level}", *(spread(column, "{:.2f}") for column in zip(*found, strict=True))])
    if rows:
        harness.print_heading(f"Simulated walks, trajectory: {chosen.trajectory}, {chosen.seeds} seeds")
        lags = [f"correlation {lag}" for lag in LAGS]
        headers = ["walk", "E (share)", "direction (deg)", "iron (uT)", "left (uT m)", "left (m)", *lags]
        harness.print_table([*headers, "compass (deg)", "p"], rows)


def of_seed(name: str, level: str, magnetometer: str, along: str, seed: int) -> tuple[float, ...]:
    """Figures of one simulated walk, in the order of the table."""
    walk, truth, earth = simulated(name, level, magnetometer, seed)
    true = way_of(walk, truth)
    way = true if along == TRUE else placed(way_of(walk, _inertial(walk, truth, along)), truth)
    fit = fitted(way)
    direction = np.degrees(wrap_angle(np.radians(towards(fit.earth) - towards(earth))))
    spread = np.degrees(np.std([wrap_angle(np.radians(towards(f) - towards(earth))) for f in true.stance_field]))
    share = fit.strength / float(np.hypot(*earth[:2]))
    correlations = [fit.correlation(lag) for lag in LAGS]
    left = fit.iron_along(way), fit.rms, fit.rms_m, *correlations
    return share, float(direction), *left, float(spread), of_pieces(way)


def _inertial(walk: Walk, truth: Trajectory, along: str) -> Trajectory:
    own = inertial(walk)
    if along == OWN:
        return own
    off = turn_about_up(own.nav_R_body @ np.swapaxes(truth.nav_R_body, 1, 2))
    return replace(own, nav_R_body=rotation_exp(off[:, None] * np.array([0.0, 0.0, 1.0])) @ truth.nav_R_body)


def placed(way: Way, truth: Trajectory) -> Way:
    """Return the way with its field summed as it is, and the places of the truth."""
    return replace(way, trajectory=replace(way.trajectory, position=truth.position))


def of_pieces(way: Way) -> float:
    """Share of orders of the strides that leave no more than the true one, mean over pieces of a walk."""
    rng = np.random.default_rng(1)
    pieces = [way.piece(start, start + PIECE) for start in range(0, len(way.u) - PIECE, PIECE)]
    return float(np.mean([as_good(shuffled(piece, PIECE_SHUFFLES, rng), fitted(piece)) for piece in pieces]))


def as_good(orders: Floats, fit: Fit) -> float:
    """Share of orders that leave no more than the true one."""
    return float(np.mean(orders <= fit.rms_m))


def simulated(name: str, level: str, magnetometer: str, seed: int) -> tuple[Walk, Trajectory, Floats]:
    """A simulated walk, its true trajectory, and the Earth's field (3,) uT."""
    source = Simulated(name, level, seed)
    walk = source.prepare(magnetometer)
    truth = walk.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    return walk, Trajectory(truth.nav_R_body, truth.position), find_earth_field(scenario(name).site).vector


def print_real(data: Path, names: Sequence[str] | None = None) -> None:
    """One row a walk, and the middle of all."""
    ways = list(real(data, names))
    headers = ("walk", "strides", "length (m)", "extent (m)", "E (uT)", "stance (uT)", "direction (deg)", "left (uT m)")
    controls = ("left (m)", "shuffled (m)", "p", "shifted (m)", "strange E (uT)")
    harness.print_heading("Real walks along the trajectory of the smoother without magnetometer")
    _print_rows((*headers, *controls), [(name, of_real(way)) for name, way in ways])
    twice = [(name, of_places(way)) for name, way in ways if len(way.passed_twice()[0]) >= MIN_PLACES]
    if twice:
        harness.print_heading("Places passed twice (uT m)")
        words = ("pairs", "anywhere", "there", "left", "iron (uT)", "tied: left", "there", "iron (uT)")
        _print_rows(("walk", *words, "shifted: left", "there"), twice)


def _print_rows(headers: Sequence[str], found: Sequence[tuple[str, tuple[float, ...]]]) -> None:
    rows = [[name, *(_plain(value) for value in values)] for name, values in found]
    middle = [_plain(float(np.median(np.abs(x)))) for x in zip(*(values for _, values in found), strict=True)]
    harness.print_table(headers, [*rows, ["median", *middle]])


def _plain(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100 or value == round(value) else f"{value:.2f}"


def real(data: Path, names: Sequence[str] | None) -> Iterator[tuple[str, Way]]:
    """Ways of the real walks that have a magnetometer."""
    for group, members in walks.REAL_WALKS.items():
        for name in (f"{group} {member}" for member in members):
            if names is None or name in names:
                yield name, real_way(name, data)


def real_way(name: str, data: Path | None) -> Way:
    """Of one real walk, along the trajectory of the smoother without magnetometer."""
    group, member = name.split()
    walk = Recorded(walks.real_path(group, member, walks.data_folder(data))).prepare(RAW)
    return way_of(walk, inertial(walk))


def inertial(walk: Walk) -> Trajectory:
    """What the smoother makes of a walk without its magnetometer."""
    heading = np.radians(walk.options.heading_deg or 0.0)
    solution = smooth(replace(walk.recording, mag=None), walk.stances, heading=float(heading))
    return Trajectory(solution.nav_R_body, solution.position)


def of_real(way: Way, seed: int = 1) -> tuple[float, ...]:
    """Figures of one real walk, in the order of the table."""
    rng = np.random.default_rng(seed)
    fit, stance = fitted(way), way.stance_field.mean(axis=0)
    orders = shuffled(way, SHUFFLES, rng)
    others = [fitted(other).rms_m for other in elsewhere(way, _in_nav)]
    strange = [fitted(other).strength for other in elsewhere(way, _as_it_is)]
    direction = np.degrees(wrap_angle(np.radians(towards(fit.earth) - towards(stance))))
    return (
        float(len(way.u) - 1),
        way.length_m,
        float(np.ptp(way.position[:, :2], axis=0).max()),
        fit.strength,
        float(np.hypot(*stance[:2])),
        float(direction),
        fit.rms,
        fit.rms_m,
        float(np.median(orders)),
        as_good(orders, fit),
        float(np.median(others)),
        float(np.median(strange)),
    )


def of_places(way: Way) -> tuple[float, ...]:
    """Figures of the places passed twice, in the order of the table."""
    first, again = way.passed_twice()

    def there(fit: Fit) -> float:
        return float(np.sqrt(np.mean((fit.left[again] - fit.left[first]) ** 2)))

    fit, tied = fitted(way), fitted(way, tied=True)
    others = [fitted(other, tied=True) for other in elsewhere(way, _in_nav)]
    ends = float(np.median([other.rms for other in others])), float(np.median([there(other) for other in others]))
    plain = float(np.sqrt(2.0)) * fit.rms, there(fit), fit.rms, fit.iron_along(way)
    return float(len(first)), *plain, tied.rms, there(tied), tied.iron_along(way), *ends


def shuffled(way: Way, draws: int, rng: np.random.Generator) -> Floats:
    """Metres (draws,) left over where what each stride leaves comes in a random order."""
    left = fitted(way).left
    change, said = np.diff(left), way.u - left
    orders = (np.concatenate(([0.0], np.cumsum(rng.permutation(change)))) for _ in range(draws))
    return np.array([fitted(replace(way, u=said + order)).rms_m for order in orders])


Turning = Callable[[Way], tuple[Floats, Floats]]


def elsewhere(way: Way, turning: Turning) -> list[Way]:
    """Return the way with the fields of other strides, some distances on."""
    shifts = [round(x) for x in np.linspace(0.25, 0.75, SHIFTS) * (len(way.u) - 1)]
    return [summed(way, shifted(way, strides, turning)) for strides in shifts]


def shifted(way: Way, strides: int, turning: Turning) -> Floats:
    """Body field (N, 3) uT in which each stride has the deviations of another, so many further on, round the end."""
    R, middle = turning(way)
    deviation = np.einsum("nab,nb->na", R, way.body_field) - middle
    number = np.arange(len(way.footfall))
    share = np.interp(way.t, way.t[way.footfall], number)
    there = (share + strides) % number[-1]
    seen = np.isfinite(deviation[:, 0])
    other = np.stack([np.interp(there, share[seen], column) for column in deviation[seen].T], axis=1)
    out = np.einsum("nba,nb->na", R, other + middle)
    out[~seen] = np.nan
    return np.asarray(out)


def _in_nav(way: Way) -> tuple[Floats, Floats]:
    """Deviations in the navigation frame from the mean field of the footfalls."""
    return way.trajectory.nav_R_body, way.stance_field.mean(axis=0)


def _as_it_is(way: Way) -> tuple[Floats, Floats]:
    """The field as the sensor has it."""
    return np.broadcast_to(np.eye(3), way.trajectory.nav_R_body.shape), np.zeros(3)


if __name__ == "__main__":
    harness.run(main)
