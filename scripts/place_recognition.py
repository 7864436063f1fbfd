"""Places that are recognized by the magnetic field: what is found, what is missed, and what is false.

    python scripts/place_recognition.py [--sections NAME ...] [--seeds N] [--first SEED] [--data DIR]

Simulated walks begin at seed 101; what was tuned was tuned on seeds 1 to 4. The odometry is the smoother without
magnetometer, aligned with the truth over its first 30 m; its uncertainty is claimed as 4 m and 2 % of the distance. The
simulator's feet come back to within 0.07 m of their old line; people do not. So each walk is moved aside by a slow
wander of 0.25 m (rms, correlation length 5 m), in truth, odometry and field: two passes are 0.35 m apart (rms).

========== ==========================================================================================================
coherence  of two passes, by wavelength: of the mean over distance, and of values at the footfalls
simulated  walks that return. recall: share of the path that was passed before (within 1 m) and is recognized; false:
           ties whose moments are more than 2 m apart; along, aside: rms of the others, m
alone      walks that do not return, all pairs of stretches allowed: chance is what the score promises to find
hard       no returns, but corridors 3 m apart, two floors, rows of a building that repeats itself every 10 m
phones     precision and recall by the length of the stretch, against ARKit
foot       543 m by zero-velocity odometry, five returns: apart before and after a relaxation with the ties
feet       the gdin and openshoe walks by the smoother without magnetometer
ablation   what enters the score: evidence (nats a meter, in units of chance) and recall, office and teaching-building
cost       seconds for walks of 1 to 8 km in one building, laps and all
========== ==========================================================================================================
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from time import perf_counter

import harness
import numpy as np
import walks
from harness import option, spread
from scipy.io import loadmat
from scipy.optimize import least_squares
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Bools, Floats
from fg_nav.lab.campaign.walks import LOOP, RAW, Recorded, Simulated
from fg_nav.lab.simulation.fields import Field, draw_environment, find_earth_field
from fg_nav.places import Signature, Stretch, alignment, recognize, select_consistent, trace_signature
from fg_nav.places.recognition import ALONG_SIGMA_M, LATERAL_SIGMA_M
from fg_nav.places.signature import SPACING_M, clip_deviation, remove_common_field
from fg_nav.smoother import smooth
from fg_nav.truth import TrajectoryTruth

SECTIONS = ("coherence", "simulated", "alone", "hard", "phones", "foot", "feet", "ablation", "cost")
RETURNING = ("office", "teaching-building", "mall")
ALONE = ("office-open",)
LEVELS = ("smooth", "indoor")

ASIDE_M, ASIDE_LENGTH_M = 0.25, 5.0  # Wander of a pass, and its correlation length.
TIE_M = 6.0  # Between ties of a stretch: nearer ones share their errors.
MAX_PASSES = 3  # Earlier passes that a place is tied to: more of them share its own error.
PASSED_M, FALSE_M = 1.0, 2.0  # So near is a return; so far apart are the moments of a false tie.


@dataclass(frozen=True)
class Claim:
    """Uncertainty that a path claims: meters and a share of the distance."""

    base_m: float = 4.0
    share: float = 0.02
    heading_deg: float = 5.0

    def position_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m."""
        return self.base_m + self.share * np.abs(second - first)

    def height_m(self, first: Floats, second: Floats) -> Floats:
        """(M,) m."""
        return 1.0 + 0.01 * np.abs(second - first)

    def heading_rad(self, first: Floats, second: Floats) -> Floats:
        """(M,) rad."""
        return np.deg2rad(self.heading_deg + 0.05 * np.abs(second - first))


ANYWHERE = Claim(1e3, 0.0, 180.0)


@dataclass(frozen=True)
class Path3:
    """A path with its field: t (N,) s, position (N, 3) m, nav_R_body (N, 3, 3), mag (N, 3) uT; true position."""

    t: Floats
    position: Floats
    nav_R_body: Floats
    mag: Floats
    truth: Floats

    @property
    def signature(self) -> Signature:
        """The field by distance."""
        return trace_signature(self.t, self.position, self.nav_R_body, self.mag)

    def true_at(self, t: Floats) -> Floats:
        """(M, 3) m."""
        return np.stack([np.interp(t, self.t, column) for column in self.truth.T], axis=1)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        sections=option(SECTIONS, "which", nargs="+", choices=SECTIONS),
        seeds=5,
        first=harness.FIRST_SEED,
        data=None,
    )
    for name in chosen.sections:
        PRINT[name](chosen)


# --- simulated walks --------------------------------------------------------------------------------------------------


def simulated(name: str, level: str, seed: int) -> Path3:
    """Simulate a walk, smooth it without its magnetometer, and move it aside."""
    source = Simulated(name, level, seed)
    walk, made = source.prepare(LOOP), source._with_iron
    recording, truth = walk.recording, walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    assert truth.nav_R_body is not None
    assert recording.mag is not None
    own = smooth(recording, walk.stances, heading=0.0)
    place, R = truth.position, truth.nav_R_body
    aside = move_aside(place, seed)
    change = difference_of_field(made.field, place + made.origin, aside)
    turn = laid_on(own.position, place)
    odometry = (own.position - own.position[0]) @ turn.T
    # The same wander as the path has it, with its yaw.
    yaw = np.einsum("ij,njk,nlk->nil", turn, own.nav_R_body, R)
    mag = recording.mag + np.einsum("nji,nj->ni", R, change)
    return Path3(
        recording.t,
        odometry + np.einsum("nij,nj->ni", yaw, aside),
        np.einsum("ij,njk->nik", turn, own.nav_R_body),
        mag,
        place + aside,
    )


def move_aside(place: Floats, seed: int) -> Floats:
    """Displacement (N, 3) m to the left of a path (N, 3), a slow random wander along it."""
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place[:, :2], axis=0), axis=1))])
    grid = np.arange(0.0, walked[-1] + 1.0, 0.25)
    distinct, first = np.unique(walked, return_index=True)
    line = np.stack([np.interp(grid, distinct, place[first, k]) for k in (0, 1)], axis=1)
    i = np.arange(len(grid))
    chord = line[np.minimum(i + 4, len(grid) - 1)] - line[np.maximum(i - 4, 0)]
    u = chord / np.maximum(np.linalg.norm(chord, axis=1, keepdims=True), 1e-9)
    reach = np.arange(-100, 101) * 0.25
    window = np.exp(-((reach / ASIDE_LENGTH_M) ** 2))
    noise = np.random.default_rng([seed, 77]).standard_normal(len(grid) + 200)
    wander = ASIDE_M * np.convolve(noise, window, "valid") / np.linalg.norm(window)
    left = np.stack([-u[:, 1] * wander, u[:, 0] * wander, 0.0 * wander], axis=1)
    return np.stack([np.interp(walked, grid, column) for column in left.T], axis=1)


def difference_of_field(field: Field, place: Floats, aside: Floats) -> Floats:
    """By how much the field (N, 3) uT changes with a displacement (N, 3), from every second sample."""
    some = slice(None, None, 2)
    change = field.at(place[some] + aside[some]) - field.at(place[some])
    samples = np.arange(len(place))
    return np.stack([np.interp(samples, samples[some], column) for column in change.T], axis=1)


def laid_on(path: Floats, truth: Floats, over_m: float = 30.0) -> Floats:
    """Turn about up (3, 3) that lays the begin of a path on the truth."""
    walked = np.cumsum(np.linalg.norm(np.diff(truth[:, :2], axis=0), axis=1))
    n = int(np.searchsorted(walked, over_m))
    a, b = path[:n, :2] - path[0, :2], truth[:n, :2] - truth[0, :2]
    angle = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    return Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()


@dataclass(frozen=True)
class Tie:
    """Two moments of a walk at one place.

    `later_s`, `earlier_s` are when, `later_m`, `earlier_m` the distances that were walked until then; `stretch` is the
    number of the stretch that it belongs to.
    """

    later_s: float
    earlier_s: float
    later_m: float
    earlier_m: float
    stretch: int


def list_ties(path: Signature, stretches: Sequence[Stretch]) -> tuple[Tie, ...]:
    """List ties along stretches, the best one first, `TIE_M` apart, of no place to more than `MAX_PASSES`."""
    tied: Counter[int] = Counter()
    ties = []
    for number, stretch in enumerate(stretches):
        for tie in ties_of(path, number, stretch):
            piece = int(tie.later_m // TIE_M)
            if tied[piece] < MAX_PASSES:
                tied[piece] += 1
                ties.append(tie)
    return tuple(ties)


def ties_of(path: Signature, number: int, stretch: Stretch) -> list[Tie]:
    """In the middle of as many equal parts: the ends of an alignment are its least certain points."""
    count = max(round(stretch.length_m / TIE_M), 1)
    row = np.unique(np.round((np.arange(count) + 0.5) / count * (len(stretch.later) - 1)).astype(np.int64))
    points = np.arange(len(path), dtype=float)
    (later_s, later_m), (earlier_s, earlier_m) = (
        [np.interp(at[row], points, values).tolist() for values in (path.t, path.distance_m)]
        for at in (stretch.later, stretch.earlier)
    )
    return [Tie(*moments, number) for moments in zip(later_s, earlier_s, later_m, earlier_m, strict=True)]


def recognized(path: Signature, claim: Claim) -> tuple[tuple[Stretch, ...], tuple[Tie, ...]]:
    """Consistent stretches of a path, and their ties."""
    stretches = select_consistent(path, recognize(path, claim).stretches, claim)
    return stretches, list_ties(path, stretches)


def passed_before(place: Floats) -> Bools:
    """Whether points (K, 3) of a signature were passed before, more than 15 m of walking ago."""
    tree = KDTree(place)
    near = tree.query_ball_point(place, PASSED_M)
    return np.array([any(i - j > 15.0 / SPACING_M for j in row) for i, row in enumerate(near)])


def tie_errors(walk: Path3, path: Signature, ties: Sequence[Tie]) -> tuple[Floats, Floats]:
    """Errors (T,), (T,) m of ties along the path and to the side, by the truth."""
    later, earlier = np.array([(tie.later_s, tie.earlier_s) for tie in ties]).reshape(-1, 2).T
    place = walk.true_at(path.t)
    u = np.stack([np.interp(earlier, path.t, np.gradient(column)) for column in place[:, :2].T], axis=1)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    e = (walk.true_at(later) - walk.true_at(earlier))[:, :2]
    return (e * u).sum(axis=1), u[:, 0] * e[:, 1] - u[:, 1] * e[:, 0]


def of_walk(name: str, level: str, seed: int) -> tuple[float, ...]:
    """Figures of one walk that returns, in the order of the table."""
    walk = simulated(name, level, seed)
    path, begin = walk.signature, perf_counter()
    stretches, ties = recognized(path, Claim())
    took = perf_counter() - begin
    again = passed_before(walk.true_at(path.t))
    found = np.zeros(len(path), dtype=bool)
    for stretch in stretches:
        found[stretch.later.astype(int)] = True
    along, aside = tie_errors(walk, path, ties)
    false = np.hypot(along, aside) > FALSE_M
    rms = [float(np.sqrt(np.mean(e[~false] ** 2))) for e in (along, aside)]
    drift = np.linalg.norm((walk.position - walk.truth)[:, :2], axis=1).max()
    return float(np.mean(found[again])), len(ties), false.sum(), *rms, float(drift), took


def print_returning(chosen: argparse.Namespace) -> None:
    """One row a scenario and field."""
    rows = []
    for name in RETURNING:
        for level in LEVELS:
            found = harness.map_walks(partial(of_walk, name, level), harness.seeds_of(chosen), 1, f"{name}, {level}")
            rows.append([f"{name}, {level}", *(spread(column, "{:.3g}") for column in zip(*found, strict=True))])
    harness.print_heading(f"Walks that return, {chosen.seeds} seeds")
    heads = ["walk", "recall", "ties", "false", "along (m)", "aside (m)", "drift at most (m)", "seconds"]
    harness.print_table(heads, rows)


def print_alone(chosen: argparse.Namespace) -> None:
    """Walks that never return, where all pairs of stretches are allowed."""
    rows = []
    for level in LEVELS:
        least, used, promised = [], 0, 0.0
        for seed in harness.seeds_of(chosen):
            path = simulated("office-open", level, seed).signature
            found = recognize(path, ANYWHERE)
            least.append(min((s.expected_false for s in found.stretches), default=1.0))
            used += len(select_consistent(path, found.stretches, ANYWHERE))
            promised += 0.1
        listed = sum(value < 0.1 for value in least)
        rows.append([f"office-open, {level}", str(chosen.seeds), f"{promised:.1f}", str(listed), str(used)])
    harness.print_heading("Walks that do not return, a square kilometer of pairs each")
    harness.print_table(["walk", "walks", "listed by promise", "listed", "used"], rows)


# --- hard places ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Repeating:
    """A field that is the same every so many meters to the north."""

    field: Field
    every_m: float

    def at(self, place: Floats) -> Floats:
        """(N, 3) uT."""
        moved = place.copy()
        moved[:, 1] = np.mod(place[:, 1] + 0.5 * self.every_m, self.every_m) - 0.5 * self.every_m
        return self.field.at(moved)


def corridors(count: int, apart_m: float, length_m: float = 40.0, up_m: float = 0.0) -> Floats:
    """Corners (M, 3) of so many corridors to the east, walked to and fro."""
    rows = [[(0.0, k * apart_m, up_m), (length_m, k * apart_m, up_m)][:: -1 if k % 2 else 1] for k in range(count)]
    return np.array([corner for row in rows for corner in row])


def along_corners(corners: Floats, step_m: float = 0.05) -> Floats:
    """Points (N, 3) along straight lines between corners (M, 3)."""
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    asked = np.arange(0.0, arc[-1], step_m)
    return np.stack([np.interp(asked, arc, column) for column in corners.T], axis=1)


def carried(place: Floats, field: Sequence[tuple[Bools, Field]], seed: int) -> Path3:
    """A sensor that swings as a foot does along points (N, 3) at 1.2 m/s, with an odometry that drifts."""
    rng = np.random.default_rng([seed, 5])
    moved = place + move_aside(place, seed)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(moved, axis=0), axis=1))])
    swing = 0.1 + 0.1 * np.sin(np.pi * arc / 1.35)[:, None] ** 2 * [0.0, 0.0, 1.0]
    mag = np.zeros_like(moved)
    for part, of_part in field:
        mag[part] = of_part.at(moved[part] + swing[part])
    mag += rng.normal(0.0, 0.3, mag.shape)
    # Heading walks at random, 1 deg after 50 m; the scale is wrong by 0.5 %.
    yaw = np.cumsum(rng.normal(0.0, np.deg2rad(1.0), len(arc)) * np.sqrt(0.05 / 50.0))
    turn = Rotation.from_rotvec(yaw[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    steps = np.einsum("nij,nj->ni", turn[1:], np.diff(moved, axis=0)) * (1.0 + rng.normal(0.0, 0.005))
    return Path3(arc / 1.2, np.vstack([np.zeros(3), np.cumsum(steps, axis=0)]), turn, mag, moved)


def hard(kind: str, level: str, seed: int) -> Path3:
    """One of the hard places."""
    rng, earth = np.random.default_rng([seed, 9]), find_earth_field("munich")
    if kind == "parallel":
        corners = corridors(12, 3.0)
        place = along_corners(corners)
        return carried(place, [(np.ones(len(place), dtype=bool), draw_environment(level, earth, corners, rng))], seed)
    if kind == "repeating":
        first = corridors(1, 10.0)
        place = along_corners(corridors(10, 10.0))
        field = Repeating(draw_environment(level, earth, first, rng), 10.0)
        return carried(place, [(np.ones(len(place), dtype=bool), field)], seed)
    below = corridors(6, 8.0)
    up = np.array([0.0, 0.0, 3.2])
    floors = [below, below + up]
    place = along_corners(np.vstack([below, below[-1:] + up, floors[1]]))
    upper = place[:, 2] > 1.6
    return carried(
        place,
        [
            (~upper, draw_environment(level, earth, floors[0], rng)),
            (upper, draw_environment(level, earth, floors[1], rng)),
        ],
        seed,
    )


def print_hard(chosen: argparse.Namespace) -> None:
    """Walks that look as if they returned."""
    rows = []
    for kind in ("parallel", "floors", "repeating"):
        for level in LEVELS:
            used, false, total = 0, 0, 0
            for seed in harness.seeds_of(chosen):
                walk = hard(kind, level, seed)
                path = walk.signature
                _, ties = recognized(path, Claim(0.5, 0.01, 3.0))
                along, aside = tie_errors(walk, path, ties)
                height = [np.diff(walk.true_at(np.array([x.earlier_s, x.later_s]))[:, 2])[0] for x in ties]
                apart = np.sqrt(along**2 + aside**2 + np.array(height) ** 2) if ties else np.zeros(0)
                used, false, total = used + bool(ties), false + int((apart > FALSE_M).sum()), total + len(ties)
            rows.append([f"{kind}, {level}", str(chosen.seeds), str(used), str(total), str(false)])
    harness.print_heading("Hard places (no pass of a corridor returns to it)")
    harness.print_table(["walk", "walks", "with ties", "ties", "false"], rows)


# --- coherence --------------------------------------------------------------------------------------------------------

EDGES_M = (20.0, 10.0, 5.0, 10 / 3, 2.5, 2.0, 1.4)


def print_coherence(chosen: argparse.Namespace) -> None:
    """Coherence of two passes by wavelength."""
    rows = []
    for level in LEVELS:
        walk = simulated("office", level, chosen.first)
        path = walk.signature
        place, field = walk.true_at(path.t), clip_deviation(remove_common_field(path.field, path.heading))
        for band, values in coherence(place, path.heading, field):
            rows.append([f"office, {level}", band, *(f"{v:.2f}" for v in values)])
    harness.print_heading("Coherence of two passes 0.35 m aside of each other, mean over distance")
    harness.print_table(["walk", "wavelength (m)", "along", "left", "up"], rows)


def coherence(place: Floats, heading: Floats, field: Floats, length: int = 40) -> Iterator[tuple[str, Floats]]:
    """By bands of wavelengths: coherence (3,) of windows that were passed twice in the same direction."""
    tree, window = KDTree(place), np.hanning(length)[:, None]
    pairs = []
    for i in range(0, len(place) - length, length // 2):
        near = [
            j for j in tree.query_ball_point(place[i], 1.2) if j - i > length and np.cos(heading[j] - heading[i]) > 0.9
        ]
        j = min(near, key=lambda j: float(np.linalg.norm(place[j] - place[i])), default=None)
        if (
            j is not None
            and j + length <= len(place)
            and np.linalg.norm(place[j + length - 1] - place[i + length - 1]) < 1.2
        ):
            pairs.append(
                [
                    np.fft.rfft((b - b.mean(axis=0)) * window, axis=0)
                    for b in (field[i : i + length], field[j : j + length])
                ]
            )
    first, again = np.array(pairs).swapaxes(0, 1)
    wave = np.fft.rfftfreq(length, SPACING_M)
    for high, low in pairwise(EDGES_M):
        band = (wave >= 1 / high) & (wave < 1 / low)
        cross = (first * again.conj())[:, band].real.sum(axis=(0, 1))
        power = [(np.abs(f[:, band]) ** 2).sum(axis=(0, 1)) for f in (first, again)]
        yield f"{low:.1f} to {high:.1f}", cross / np.sqrt(power[0] * power[1])


# --- real paths -------------------------------------------------------------------------------------------------------


def phone(folder: Path, name: str) -> Path3:
    """A phone's path by ARKit; its magnetometer has other axes, turned by 90 deg about z."""
    file = loadmat(folder / f"{name}.mat")
    position = np.vstack([np.zeros(3), np.cumsum(file["dPos"], axis=0)])
    R = Rotation.from_quat(file["quat"][:, [1, 2, 3, 0]]).as_matrix()
    return Path3(file["t"].ravel(), position, R, file["m"][:, [1, 0, 2]] * [-1.0, 1.0, 1.0], position)


NEAR_M = (1.0, 2.0, 3.0, 5.0)


def print_phones(chosen: argparse.Namespace) -> None:
    """Precision and recall, with an odometry that knows where and without; distances by ARKit, and relaxed."""
    folder, rows = walks.data_folder(chosen.data) / "magnetic_paths", []
    for name in ("mall", "square", "eight"):
        walk = phone(folder, name)
        path = walk.signature
        again = passed_before(walk.true_at(path.t))
        for claim, words in ((Claim(2.0, 0.01), "2 m, 1 %"), (Claim(5.0, 0.03), "5 m, 3 %"), (ANYWHERE, "anywhere")):
            stretches, ties = recognized(path, claim)
            found = np.zeros(len(path), dtype=bool)
            for s in stretches:
                found[s.later.astype(int)] = True
            by_truth = apart(path, path.position, ties)
            scatter = about_means(path, ties)
            precision = [f"{np.mean(by_truth < near):.2f}" if ties else "-" for near in NEAR_M]
            after = apart(path, relax(path, ties), ties) if ties else np.zeros(0)
            lengths = ", ".join(f"{s.length_m:.0f}" for s in stretches)
            recall = f"{np.mean(found[again]):.2f} of {again.sum() * SPACING_M:.0f} m"
            rows.append(
                [name, words, lengths, str(len(ties)), *precision, recall, rms(by_truth), rms(scatter), rms(after)]
            )
    harness.print_heading(
        "Phones: share of the ties that are so near each other by ARKit; recall of what was passed within 1 m"
    )
    near = [f"{near:.0f} m" for near in NEAR_M]
    harness.print_table(
        ["walk", "claimed", "stretches (m)", "ties", *near, "recall", "apart (m)", "about means (m)", "relaxed (m)"],
        rows,
    )


def rms(values: Floats) -> str:
    """Root of the mean square, in words."""
    return f"{np.sqrt(np.mean(values**2)):.2f}" if len(values) else "-"


def foot_walk(folder: Path) -> Path3:
    """The foot of 543 m; its navigation frame has z down."""
    file = loadmat(folder / "foot_odometry_543m.mat")
    z_up = np.diag([1.0, -1.0, -1.0])
    R = [Rotation.from_quat(file["q_0"].ravel()[[1, 2, 3, 0]])]
    for turn in Rotation.from_rotvec(file["delta_q"].T):
        R.append(turn * R[-1])
    position = np.cumsum(file["delta_p"], axis=1).T @ z_up
    t = 0.1 * np.arange(len(position))
    return Path3(t, position, z_up @ np.array([r.as_matrix() for r in R[1:]]), 100.0 * file["y_mag"].T, position)


def print_foot(chosen: argparse.Namespace) -> None:
    """Five returns of a foot: how far apart by odometry, and after a relaxation."""
    path = foot_walk(walks.data_folder(chosen.data) / "magnetic_paths").signature
    claim = Claim()
    found = recognize(path, claim)
    stretches = select_consistent(path, found.stretches, claim)
    ties = list_ties(path, stretches)
    relaxed = relax(path, ties)
    rows = []
    for number, s in enumerate(stretches):
        of = [tie for tie in ties if tie.stretch == number]
        rows.append(
            [
                f"{path.distance_m[int(s.later[0])]:.0f} to {path.distance_m[int(s.later[-1])]:.0f}",
                f"{path.distance_m[int(s.earlier[0])]:.0f} to {path.distance_m[int(s.earlier[-1])]:.0f}",
                f"{s.score:.0f}",
                f"{s.expected_false:.0e}",
                *(spread(apart(path, p, of), "{:.2f}", (0, 100)) for p in (path.position, relaxed)),
            ]
        )  # fmt: skip
    harness.print_heading(
        f"The foot of 543 m: {len(found.stretches)} stretches recognized, {len(stretches)} consistent, {len(ties)} ties"
    )
    harness.print_table(["later (m)", "earlier (m)", "score", "false by chance", "apart (m)", "relaxed (m)"], rows)
    out = relax(path, [tie for tie in ties if tie.stretch % 2 == 0])
    left = [tie for tie in ties if tie.stretch % 2]
    harness.print_heading(
        f"Left out of the relaxation: {spread(apart(path, out, left), '{:.2f}')} m apart, "
        f"before {spread(apart(path, path.position, left), '{:.2f}')}"
    )
    laps = [int(np.argmin(np.abs(path.distance_m - m))) for m in return_points(path, stretches)]
    harness.print_heading(
        f"Passes of one place: {len(laps)}, {widest(relaxed[laps]):.2f} m apart at most; "
        f"by odometry {widest(path.position[laps]):.2f}"
    )


def widest(place: Floats) -> float:
    """Largest horizontal distance of points (P, 3) from each other, m."""
    return float(np.linalg.norm(place[:, None, :2] - place[:, :2], axis=2).max())


def return_points(path: Signature, stretches: Sequence[Stretch]) -> list[float]:
    """Distances at which the place 20 m from the start is passed, by the stretches."""
    points = np.arange(len(path), dtype=float)
    found = [20.0]
    for s in stretches:
        at = np.interp(s.earlier, points, path.distance_m)
        if not s.opposite and at[0] <= 20.0 <= at[-1]:
            found.append(float(np.interp(20.0, at, np.interp(s.later, points, path.distance_m))))
    return sorted(found)


def apart(path: Signature, position: Floats, ties: Sequence[Tie]) -> Floats:
    """Horizontal distances (T,) m of the moments of ties at positions (K, 3)."""
    later, earlier = (np.array([getattr(tie, name) for tie in ties]) for name in ("later_m", "earlier_m"))
    p = [np.stack([np.interp(m, path.distance_m, c) for c in position[:, :2].T], axis=1) for m in (later, earlier)]
    return np.linalg.norm(p[0] - p[1], axis=1)


def about_means(path: Signature, ties: Sequence[Tie]) -> Floats:
    """(T,) m by which displacements of ties differ from the mean of their stretch: one shift is the truth's drift."""
    later, earlier = (np.array([getattr(tie, name) for tie in ties]) for name in ("later_m", "earlier_m"))
    e = np.stack(
        [np.interp(later, path.distance_m, c) - np.interp(earlier, path.distance_m, c) for c in path.position[:, :2].T],
        axis=1,
    )
    stretch = np.array([tie.stretch for tie in ties], dtype=int)
    mean = np.array([e[stretch == k].mean(axis=0) for k in stretch]).reshape(-1, 2)
    return np.linalg.norm(e - mean, axis=1)


def relax(path: Signature, ties: Sequence[Tie], every: int = 8) -> Floats:
    """Bend a path (K, 3) by least squares: heading and scale of its pieces walk at random, ties hold.

    Pieces of 4 m; the heading changes by 0.3 deg in each (1 sigma), the length of each is good to 1 %.
    """
    knots = np.arange(0, len(path), every)
    step = np.diff(path.position[knots, :2], axis=0)
    knot_m = path.distance_m[knots]

    def positions(x: Floats) -> tuple[Floats, Floats]:
        yaw, scale = np.cumsum(x[: len(step)] * np.deg2rad(0.3)), 1.0 + 0.01 * x[len(step) :]
        c, s = np.cos(yaw), np.sin(yaw)
        moved = np.stack([c * step[:, 0] - s * step[:, 1], s * step[:, 0] + c * step[:, 1]], axis=1) * scale[:, None]
        return np.vstack([path.position[0, :2], path.position[0, :2] + np.cumsum(moved, axis=0)]), np.append(
            yaw, yaw[-1]
        )

    later, earlier = (np.array([getattr(tie, name) for tie in ties]) for name in ("later_m", "earlier_m"))

    def bent(x: Floats, m: Floats) -> tuple[Floats, Floats]:
        p, yaw = positions(x)
        own = np.stack(
            [
                np.interp(m, path.distance_m, c) - np.interp(m, knot_m, path.position[knots, k])
                for k, c in enumerate(path.position[:, :2].T)
            ],
            axis=1,
        )
        turn = np.interp(m, knot_m, yaw)
        c, s = np.cos(turn), np.sin(turn)
        own = np.stack([c * own[:, 0] - s * own[:, 1], s * own[:, 0] + c * own[:, 1]], axis=1)
        return np.stack([np.interp(m, knot_m, column) for column in p.T], axis=1) + own, turn

    def residuals(x: Floats) -> Floats:
        (a, _), (b, turn) = bent(x, later), bent(x, earlier)
        psi = np.interp(earlier, path.distance_m, path.heading) + turn
        e = a - b
        along, left = np.cos(psi) * e[:, 0] + np.sin(psi) * e[:, 1], np.cos(psi) * e[:, 1] - np.sin(psi) * e[:, 0]
        return np.concatenate([x, along / ALONG_SIGMA_M, left / LATERAL_SIGMA_M])

    x = least_squares(residuals, np.zeros(2 * len(step))).x
    return np.column_stack([bent(x, path.distance_m)[0], path.position[:, 2]])


def real_feet(data: Path) -> Iterator[tuple[str, Path]]:
    """Names and files of the real walks with a magnetometer."""
    for group, names in walks.REAL_WALKS.items():
        for name in names:
            yield f"{group} {name}", walks.real_path(group, name, data)


def print_feet(chosen: argparse.Namespace) -> None:
    """The gdin and openshoe walks."""
    rows = []
    for name, path_of in real_feet(walks.data_folder(chosen.data)):
        walk = Recorded(path_of).prepare(RAW)
        assert walk.recording.mag is not None
        own = smooth(walk.recording, walk.stances, heading=None)
        path = trace_signature(own.t, own.position, own.nav_R_body, walk.recording.mag)
        claim = Claim(2.0, 0.02)
        found = recognize(path, claim)
        used = select_consistent(path, found.stretches, claim)
        ties = list_ties(path, used)
        distance = f"{apart(path, path.position, ties).mean():.2f}" if ties else "-"
        again = np.mean(passed_before(np.column_stack([path.position[:, :2], np.zeros(len(path))])))
        rows.append(
            [
                name,
                f"{len(path) * SPACING_M:.0f}",
                f"{again:.2f}",
                str(len(used)),
                ", ".join(
                    f"{s.length_m:.0f} m {'opposite' if s.opposite else 'same'} {s.expected_false:.0e}" for s in used
                ),
                distance,
            ]
        )
    harness.print_heading("Real feet, odometry by the smoother without magnetometer")
    harness.print_table(["walk", "length (m)", "near itself", "recognized", "stretches", "apart (m)"], rows)


# --- ablation ---------------------------------------------------------------------------------------------------------

VARIANTS = {
    "all": (1.0, 1.0, 1.0),
    "below and left": (1.0, 1.0, 0.0),
    "below": (1.0, 0.0, 0.0),
    "left": (0.0, 1.0, 0.0),
    "above": (0.0, 0.0, 1.0),
}
"""Of the correlations of below, left, above."""


def print_ablation(chosen: argparse.Namespace) -> None:
    """Leave components of the field out, or all of it but the footfalls."""
    rows = []
    for name, level in (("office", "indoor"), ("office", "smooth"), ("teaching-building", "indoor")):
        seen = [simulated(name, level, seed) for seed in harness.seeds_of(chosen)]
        for words, factors in VARIANTS.items():
            with with_correlation(alignment.RHO * factors):
                rows.append([f"{name}, {level}", words, *weigh_evidence(seen)])
        rows.append([f"{name}, {level}", "all, footfalls only", *weigh_evidence([at_footfalls(walk) for walk in seen])])
    harness.print_heading(f"What enters the score, {chosen.seeds} seeds")
    harness.print_table(["walk", "components", "nats a meter", "recall"], rows)


@contextmanager
def with_correlation(rho: Floats) -> Iterator[None]:
    """Score with other correlations."""
    usual = alignment.RHO
    alignment.RHO = rho
    try:
        yield
    finally:
        alignment.RHO = usual


def at_footfalls(walk: Path3) -> Path3:
    """Return a walk whose magnetometer reads only where the foot stands."""
    speed = np.linalg.norm(np.gradient(walk.truth, walk.t, axis=0), axis=1)
    return replace(walk, mag=np.where(speed[:, None] < 0.1, walk.mag, np.nan))


def weigh_evidence(seen: Sequence[Path3]) -> tuple[str, str]:
    """Evidence, lambda times the score of the used stretches a meter of them, and recall, of walks."""
    evidence, recall = [], []
    for walk in seen:
        path = walk.signature
        path = replace(path, seen=np.ones(len(path), dtype=bool))
        found = recognize(path, Claim())
        used = select_consistent(path, found.stretches, Claim())
        length = sum(s.length_m for s in used)
        evidence.append(found.chance.decay * sum(s.score for s in used) / length if used else 0.0)
        marked = np.zeros(len(path), dtype=bool)
        for s in used:
            marked[s.later.astype(int)] = True
        recall.append(float(np.mean(marked[passed_before(walk.true_at(path.t))])))
    return spread(evidence, "{:.2f}"), spread(recall, "{:.2f}")


# --- cost -------------------------------------------------------------------------------------------------------------


def print_cost(chosen: argparse.Namespace) -> None:
    """Seconds by the length of the walk: laps of 340 m in one building, and a walk that never returns."""
    rows = []
    for laps in (3, 6, 12, 24):
        lap = corridors(8, 5.0)
        field = draw_environment("indoor", find_earth_field("munich"), lap, np.random.default_rng(1))
        place = along_corners(np.vstack([lap, lap[::-1]] * (laps // 2) if laps > 1 else [lap]), 0.1)
        path = carried(place, [(np.ones(len(place), dtype=bool), field)], 1).signature
        recognize(path, Claim(1.0, 0.002))
        begin = perf_counter()
        stretches, ties = recognized(path, Claim(1.0, 0.002))
        rows.append(
            [f"{len(path) * SPACING_M:.0f}", f"{perf_counter() - begin:.2f}", str(len(stretches)), str(len(ties))]
        )
    harness.print_heading("Cost in one building, to and fro")
    harness.print_table(["length (m)", "seconds", "stretches", "ties"], rows)


PRINT = {
    "coherence": print_coherence,
    "simulated": print_returning,
    "alone": print_alone,
    "hard": print_hard,
    "phones": print_phones,
    "foot": print_foot,
    "feet": print_feet,
    "ablation": print_ablation,
    "cost": print_cost,
}

if __name__ == "__main__":
    harness.run(main)
