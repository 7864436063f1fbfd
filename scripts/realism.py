"""Whether the simulated foot moves as real ones do: the same facts of both, side by side.

    python scripts/realism.py [--data DIR] [--seeds N] [--per-walk]

Real: the ten gdin walks, indoors, 35 to 150 m, a LORD GX5 on the instep. Simulated: as many metres of straight lines
and right-angled corners with the same sensor on the instep, its range unlimited, twice: persons and mounts drawn about
the default, who walk as fast as those of Ma et al. (1.29 m in 0.93 s), and the same persons in no more hurry than the
real walkers (1.32 m in 1.18 s). Stances and attitude come from the same detector and smoother for all.

Axes are the foot's, found in the recording itself: up as the force in stance, left as the principal axis of the rate.
A stride reaches from the stillest instant of one footfall to that of the next. A fact of a walk is the median over its
strides where nothing else is said. Motion capture knows the true velocity in stance: that of a day of walking, in the
Vicon trials, is compared too.

The facts of the field (`realism_field.py`) are of the same simulated walks, in the field `indoor`; the column "smooth"
shows how kind the level `smooth` is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import harness
import numpy as np
import realism_field
import walks
from sample_errors import integrate

from fg_nav.arrays import Floats, Ints
from fg_nav.detection import detect_stances
from fg_nav.detection.rolling_lever import estimate_lever
from fg_nav.detection.stance import shoe
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.lab.simulation import Person, Scenario, simulate
from fg_nav.lab.simulation.path import polyline
from fg_nav.lab.simulation.plan import Stand, Walk
from fg_nav.lab.simulation.sensors import preset
from fg_nav.lab.simulation.walk import Streams
from fg_nav.mechanisation import NavState
from fg_nav.recording import Recording, TrajectoryTruth
from fg_nav.smoother import smooth
from fg_nav.solution import Solution

Facts: TypeAlias = Sequence[Mapping[str, float]]
"""Of walks: name of a fact -> value."""

UNHURRIED_M, UNHURRIED_S = 1.32, 1.18
"""Stride of the real walkers: medians of the medians of ten walks."""

NAME = "realism"
"""Of the scenario, whose course follows."""

COURSE_M = ((0.0, 0.0), (0.0, 25.0), (12.0, 25.0), (12.0, 5.0), (22.0, 5.0), (22.0, 30.0))
CORNER_M = 0.8

STRIDE_S, SHORTEST_M = (0.6, 1.8), 0.8
"""What counts as a stride of walking."""

STRAIGHT_DEG = 20.0
"""Yaw rates are compared on strides that turn by less."""

WITHIN_S = 0.06
"""On either side of the stillest instant: short enough for a cubic to follow the rolling foot."""

MID_STANCE_S = 0.10
"""On either side of the stillest instant, where the velocity in stance is looked at."""

VICON_DAY = "2017-11-22"
"""Its trials are of walking; on the other days people also ran."""

FEWEST = 8
"""A trial with fewer strides shows none."""

SHARP_HZ = 24.0

SHARES = np.linspace(0.0, 1.0, 201)
"""Of a stride, for curves."""

PEAK_SHARE = 0.35
"""Where curves are laid over each other: the foot is steepest, toe down, after a third of a stride from mid-stance."""

FACTS: Mapping[str, tuple[str, str]] = {
    "stride_s": ("stride time (s)", "{:.2f}"),
    "stride_m": ("stride length (m)", "{:.2f}"),
    "stride_cv": ("stride time, coefficient of variation", "{:.3f}"),
    "stance_share": ("share of detected stance", "{:.2f}"),
    "toe_down_deg": ("pitch after push-off (deg)", "{:.0f}"),
    "toe_up_deg": ("pitch at heel strike, upward (deg)", "{:.0f}"),
    "rise_cm": ("rise of the sensor (cm)", "{:.1f}"),
    "pitch_deg_s": ("peak rate, pitch (deg/s)", "{:.0f}"),
    "pitch_back_deg_s": ("the same, toe coming up", "{:.0f}"),
    "pitch_per_stride": ("peak rate, pitch, times stride time (deg)", "{:.0f}"),
    "roll_deg_s": ("peak rate, roll", "{:.0f}"),
    "yaw_deg_s": ("peak rate, yaw, going straight", "{:.0f}"),
    "pitch_cv": ("peak rate, pitch: coefficient of variation", "{:.2f}"),
    "roll_cv": ("peak rate, roll: the same", "{:.2f}"),
    "curve_scatter": ("curve of the pitch rate: rms about the median curve (deg/s)", "{:.0f}"),
    "force": ("peak specific force (m/s^2)", "{:.0f}"),
    "force_95": ("the same, 95 % of strides", "{:.0f}"),
    "jerk": ("change of the force, rms (m/s^3)", "{:.0f}"),
    "angular_jerk": ("change of the rate, rms (rad/s^2)", "{:.0f}"),
    "sharp_force": ("force at heel strike: share of power above 24 Hz", "{:.3f}"),
    "sharp_rate": ("rate at heel strike: the same", "{:.4f}"),
    "stance_rate_deg_s": ("rate in stance (deg/s)", "{:.1f}"),
    "still_rate_deg_s": ("rate at the stillest instant (deg/s)", "{:.1f}"),
    "stance_gyr_deg_s": ("gyroscope within 60 ms of it, about a cubic (deg/s)", "{:.2f}"),
    "stance_acc": ("accelerometer, the same (m/s^2)", "{:.3f}"),
    "stance_sharp": ("gyroscope, the same: correlation of neighbours", "{:.2f}"),
    "shoe": ("SHOE at the stillest instant (decades)", "{:.2f}"),
    "shoe_stance": ("SHOE in stance (decades)", "{:.2f}"),
    "stance_velocity": ("change of velocity within 0.1 s of mid-stance, rms (mm/s)", "{:.1f}"),
    "lever_cm": ("height of the sensor above the rolling point (cm)", "{:.1f}"),
    "swing_velocity": ("velocity left over by strapdown after a swing (mm/s)", "{:.0f}"),
}
"""Of each fact: what it is, and how it is written."""

TRUE_FACTS: Mapping[str, tuple[str, str]] = {
    "speed": ("true speed at the stillest instant (mm/s)", "{:.1f}"),
    "speed_rms": ("true speed within 0.1 s of it, rms (mm/s)", "{:.1f}"),
    "forward": ("true forward velocity there (mm/s)", "{:.1f}"),
    "sinking": ("true downward velocity there (mm/s)", "{:.1f}"),
    "captured_rate_deg_s": FACTS["still_rate_deg_s"],
}

_EVEN = "real walkers slow down at corners and doors; the plan's pace varies less"
_LONGER = "the foot turns by the same angles in stance, which lasts longer at this pace"
_CAPTURED = "of most captured feet, 0.1 s from the stillest instant is landing or push-off already"
_SLOWER = "angles and their scatter are those of every pace, so rates fall with it"

REASONS: Mapping[str, Mapping[str, str]] = {
    "simulated": {
        "stride_s": "the default is that of Ma et al., 5 km/h",
        "stride_cv": _EVEN,
        "stance_share": "who walks faster stands for less of a stride, as little as the fastest of the real walkers",
        "pitch_back_deg_s": "a stride of 0.93 s is shorter than any of the real walks', with the same angles",
        "curve_scatter": _EVEN,
        "speed_rms": _CAPTURED,
        "captured_rate_deg_s": "the captured feet turn half as fast in stance as those of gdin, whose angles these are",
    },
    "unhurried": {
        "stride_cv": _EVEN,
        "roll_deg_s": _SLOWER,
        "yaw_deg_s": _SLOWER,
        "curve_scatter": f"{_SLOWER}; and {_EVEN}",
        "sharp_force": "the swing's own force falls with the pace, ringing and crack stay where they are in frequency",
        "stance_velocity": _LONGER,
        "speed": f"{_LONGER}; those captured walked faster",
        "swing_velocity": "it scatters fivefold with the sensor that is drawn: a few seeds may miss the real walks",
        "speed_rms": f"{_LONGER}; {_CAPTURED}",
    },
    "in the field smooth": dict.fromkeys(realism_field.FACTS, "meant to be kinder than real"),
}
"""Of each column: why a fact of its persons lies outside, or may with some seeds."""


@dataclass(frozen=True)
class Foot:
    """A walk in the axes of its foot: rate (N, 3) deg/s less bias, force (N, 3) m/s^2, strides (K, 2) as samples."""

    name: str
    recording: Recording
    solution: Solution
    rate: Floats
    force: Floats
    nav_R_foot: Floats
    still: Ints
    strides: Ints
    stance: Floats

    @property
    def period_s(self) -> float:
        """Of the samples, s."""
        return self.recording.period_s


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(__doc__, arguments, data=None, seeds=5, per_walk=False)
    data = walks.data_folder(chosen.data)
    real = [foot(walk.name, walk.recording) for walk in walks.read_gdin(data)]
    seeds = range(chosen.seeds)
    recorded = {name: [simulated(person(seed), seed) for seed in seeds] for name, person in PEOPLE.items()}
    ours = {name: [foot(name, one) for one in recordings] for name, recordings in recorded.items()}
    harness.print_heading("The moving foot: median [least, most] over walks")
    columns = {"real": real} | ours
    print_facts(FACTS, {name: [inertial_facts(walk) for walk in of] for name, of in columns.items()})
    if chosen.per_walk:
        single = [inertial_facts(walk) for walk in real]
        rows = [[words, *(form.format(facts[key]) for facts in single)] for key, (words, form) in FACTS.items()]
        harness.print_table(("fact", *(walk.name for walk in real)), rows)
    captured = motion_captured(data)
    harness.print_heading("The standing foot, with true velocities")
    columns = {"real": captured} | ours
    print_facts(TRUE_FACTS, {name: [true_facts(walk) for walk in of] for name, of in columns.items()})
    print_field(data, recorded, chosen.seeds)


def motion_captured(data: Path) -> list[Foot]:
    """The trials whose true velocity is known, those that show strides."""
    trials = [foot(w.name, w.recording) for w in walks.read_vicon_detected(data) if w.name.startswith(VICON_DAY)]
    return [walk for walk in trials if len(walk.strides) >= FEWEST]


def print_facts(facts: Mapping[str, tuple[str, str]], columns: Mapping[str, Facts]) -> None:
    """A table: the first column is real; of the others, whether the median lies in its range, and how many walks do."""
    (first, *names), (real, *others) = columns, columns.values()
    rows = []
    for key, (words, form) in facts.items():
        judged = [cell for ours in others for cell in _judged(real, ours, key, form)]
        rows.append([words, realism_field.spread_words(real, key, form), *judged, reason(names, key)])
    harness.print_table(("fact", first, *(cell for name in names for cell in (name, "", "")), ""), rows)


def _judged(real: Facts, ours: Facts, key: str, form: str) -> tuple[str, str, str]:
    return (
        realism_field.spread_words(ours, key, form),
        verdict(real, ours, key),
        f"{within(real, ours, key)} of {len(ours)}",
    )


def reason(columns: Sequence[str], key: str) -> str:
    """Why a fact lies outside in these columns, or may with some seeds; empty if it should not."""
    return "; ".join(f"{name}: {REASONS[name][key]}" for name in columns if key in REASONS.get(name, {}))


def verdict(real: Facts, ours: Facts, key: str) -> str:
    """Whether the median of ours lies within the range of the real ones."""
    values = [facts[key] for facts in real]
    return "inside" if min(values) <= np.median([facts[key] for facts in ours]) <= max(values) else "outside"


def within(real: Facts, ours: Facts, key: str) -> int:
    """How many walks of ours lie within the range of the real ones."""
    values = [facts[key] for facts in real]
    return sum(min(values) <= facts[key] <= max(values) for facts in ours)


def whoever(_: int) -> None:
    """No given person: a simulation draws one by its seed."""


def unhurried(seed: int) -> Person:
    """Return the same person, walking as the people of the real walks do."""
    usual = replace(Person(), walk=replace(Person().walk, stride_m=UNHURRIED_M, stride_s=UNHURRIED_S))
    return usual.draw(Streams(seed, NAME).lasting("person"))


PEOPLE: Mapping[str, Callable[[int], Person | None]] = {"simulated": whoever, "unhurried": unhurried}
"""Columns of the tables: whom a seed draws."""


def simulated(person: Person | None, seed: int, field: str = "indoor") -> Recording:
    """A walk of the kind of the real ones, on the sensor with which they were recorded."""
    rest = Stand(1.5)
    course = [rest, Walk(polyline(np.array(COURSE_M), CORNER_M)), rest]
    prior = preset("lord-gx5")
    prior = replace(prior, gyr=replace(prior.gyr, limit=np.inf))  # at the default pace it saturates
    scenario = Scenario(NAME, "", lambda _: course, "instep", prior, field=field)
    return simulate(scenario, seed, person=person).recording


def print_field(data: Path, people: Mapping[str, Sequence[Recording]], seeds: int) -> None:
    """The same table for the magnetic field, and the kinder level `smooth` beside it."""
    columns = {"real": [walk.facts() for walk in realism_field.real_walks(data)]}
    columns |= {name: [realism_field.sensed(walk).facts() for walk in of] for name, of in people.items()}
    kinder = [simulated(None, seed, "smooth") for seed in range(seeds)]
    columns["in the field smooth"] = [realism_field.sensed(walk).facts() for walk in kinder]
    harness.print_heading("The field at the foot")
    print_facts(realism_field.FACTS, columns)


def foot(name: str, recording: Recording) -> Foot:
    """Find stances, attitude, axes and strides."""
    stances = detect_stances(recording)
    solution = smooth(recording, stances)
    rate = recording.gyr - solution.stances.gyro_bias.mean(axis=0)
    foot_R_body = foot_axes(rate, recording.acc[stances.mask].mean(axis=0), solution)
    still = stances.stillest(recording.gyr)
    strides = [
        (i, j)
        for i, j in pairwise(still)
        if STRIDE_S[0] < recording.t[j] - recording.t[i] < STRIDE_S[1]
        and np.linalg.norm(solution.position[j] - solution.position[i]) > SHORTEST_M
    ]
    return Foot(
        name=name,
        recording=recording,
        solution=solution,
        rate=np.rad2deg(rate @ foot_R_body.T),
        force=recording.acc @ foot_R_body.T,
        nav_R_foot=solution.nav_R_body @ foot_R_body.T,
        still=still,
        strides=np.array(strides),
        stance=stances.mask,
    )


def foot_axes(rate: Floats, stance_force: Floats, solution: Solution) -> Floats:
    """foot_R_body (3, 3): up as `stance_force` (3,), left as the principal axis of the rate (N, 3), forward ahead."""
    up = stance_force / np.linalg.norm(stance_force)
    principal = np.linalg.eigh(rate.T @ rate)[1][:, -1]
    left = principal - (principal @ up) * up
    left /= np.linalg.norm(left)
    ahead = np.einsum("nji,nj->i", solution.nav_R_body, solution.velocity)
    left *= np.sign(np.cross(left, up) @ ahead)
    return np.stack([np.cross(left, up), left, up])


def inertial_facts(walk: Foot) -> dict[str, float]:
    """All of `FACTS` for a walk: name -> value."""
    return gait_facts(walk) | rate_facts(walk) | force_facts(walk) | stance_facts(walk)


def gait_facts(walk: Foot) -> dict[str, float]:
    """Times, lengths, angles."""
    first, last = walk.strides.T
    seconds = walk.recording.t[last] - walk.recording.t[first]
    pitch = np.rad2deg(np.arcsin(-walk.nav_R_foot[:, 2, 0]))
    height = walk.solution.position[:, 2]
    begun, ended = walk.still[[0, -1]]
    return {
        "stride_s": float(np.median(seconds)),
        "stride_m": float(np.median(np.linalg.norm(np.diff(walk.solution.position[walk.strides], axis=1), axis=2))),
        "stride_cv": float(seconds.std() / seconds.mean()),
        "stance_share": float(walk.stance[begun:ended].mean()),
        "toe_down_deg": _of_strides(walk, lambda i, j: np.max(pitch[i:j]) - pitch[i]),
        "toe_up_deg": _of_strides(walk, lambda i, j: pitch[i] - np.min(pitch[i:j])),
        "rise_cm": 100 * _of_strides(walk, lambda i, j: np.max(height[i:j]) - height[i]),
    }


def _of_strides(walk: Foot, fact: Callable[[int, int], float]) -> float:
    return float(np.median([fact(i, j) for i, j in walk.strides]))


def rate_facts(walk: Foot) -> dict[str, float]:
    """Peaks of the angular rate, and how they scatter."""
    roll, pitch, yaw = (np.array([pick[i:j] for i, j in walk.strides], dtype=object) for pick in walk.rate.T)
    peak = np.array([np.max(x) for x in pitch])
    rolling = np.array([np.max(np.abs(x)) for x in roll])
    straight = np.array([abs(x.sum()) * walk.period_s < STRAIGHT_DEG for x in yaw])
    seconds = np.diff(walk.recording.t[walk.strides], axis=1)[:, 0]
    curve = np.array([resampled(walk, walk.rate[:, 1], i, j) for i, j in walk.strides[straight]])
    return {
        "pitch_deg_s": float(np.median(peak)),
        "pitch_back_deg_s": float(np.median([-np.min(x) for x in pitch])),
        "pitch_per_stride": float(np.median(peak * seconds)),
        "roll_deg_s": float(np.median(rolling)),
        "yaw_deg_s": float(np.median([np.max(np.abs(x)) for x in yaw[straight]])),
        "pitch_cv": float(peak.std() / peak.mean()),
        "roll_cv": float(rolling.std() / rolling.mean()),
        "curve_scatter": float(np.sqrt(np.mean((curve - np.median(curve, axis=0)) ** 2))),
    }


def resampled(walk: Foot, values: Floats, begin: int, end: int) -> Floats:
    """Values at `SHARES` of a stride, moved so that the foot is steepest at `PEAK_SHARE`."""
    pitch = -walk.nav_R_foot[begin:end, 2, 0]
    steepest = begin + int(np.argmax(pitch))
    at = steepest + (SHARES - PEAK_SHARE) * (end - begin)
    return np.interp(at, np.arange(len(values)), values)


def force_facts(walk: Foot) -> dict[str, float]:
    """Peaks of the specific force, and how sharp force and rate are."""
    strength = np.linalg.norm(walk.force, axis=1)
    peak = [np.max(strength[i:j]) for i, j in walk.strides]
    moving = np.concatenate([np.arange(i, j) for i, j in walk.strides])
    jerk, angular = (
        np.gradient(values, walk.period_s, axis=0)[moving] for values in (walk.force, np.deg2rad(walk.rate))
    )
    return {
        "force": float(np.median(peak)),
        "force_95": float(np.percentile(peak, 95)),
        "jerk": float(np.sqrt((jerk**2).sum(axis=1).mean())),
        "angular_jerk": float(np.sqrt((angular**2).sum(axis=1).mean())),
        "sharp_force": _sharp(walk, walk.force),
        "sharp_rate": _sharp(walk, walk.rate),
    }


def _sharp(walk: Foot, values: Floats) -> float:
    """Share of the power above `SHARP_HZ`, in 0.32 s about heel strike: where the pitch is least."""
    count = round(0.32 / walk.period_s)
    frequency = np.fft.rfftfreq(count, walk.period_s)
    power = np.zeros(len(frequency))
    for i, j in walk.strides:
        strike = i + int(np.argmin(-walk.nav_R_foot[i:j, 2, 0]))
        part = values[max(strike - count // 3, 0) :][:count]
        if len(part) == count:
            window = np.hanning(count)[:, None]
            power += (np.abs(np.fft.rfft((part - part.mean(axis=0)) * window, axis=0)) ** 2).sum(axis=1)
    return float(power[frequency > SHARP_HZ].sum() / power[1:].sum())


def stance_facts(walk: Foot) -> dict[str, float]:
    """How still the standing foot is: of the footfalls between strides."""
    still = walk.strides[1:, 0]
    size = np.linalg.norm(walk.rate, axis=1)
    walking = walk.stance.copy()
    walking[: walk.strides[0, 0]] = walking[walk.strides[-1, 1] :] = False
    window = round(0.05 / walk.period_s)
    level = np.log10(shoe(walk.recording.acc, walk.recording.gyr, window))
    gyr, acc = _about_cubic(walk, walk.rate, still), _about_cubic(walk, walk.force, still)
    return {
        "stance_rate_deg_s": float(np.median(size[walking])),
        "still_rate_deg_s": float(np.median(size[still])),
        "stance_gyr_deg_s": float(np.median(np.sqrt((gyr**2).mean(axis=(1, 2))))),
        "stance_acc": float(np.median(np.sqrt((acc**2).mean(axis=(1, 2))))),
        "stance_sharp": float((gyr[:, 1:] * gyr[:, :-1]).mean() / (gyr**2).mean()),
        "shoe": float(np.median(level[still])),
        "shoe_stance": float(np.median(level[walking])),
        "stance_velocity": float(np.median([_velocity_change(walk, i) for i in still])),
        "lever_cm": _lever_cm(walk),
        "swing_velocity": float(np.median([_left_over(walk, i, j) for i, j in walk.strides])),
    }


def _about_cubic(walk: Foot, values: Floats, still: Ints) -> Floats:
    """What a cubic leaves of values (N, 3) about each instant: (K, M, 3)."""
    reach = round(WITHIN_S / walk.period_s)
    x = np.linspace(-1.0, 1.0, 2 * reach + 1)
    cubic, _ = np.linalg.qr(np.vander(x, 4))
    parts = np.array([values[i - reach : i + reach + 1] for i in still])
    return np.asarray(parts - np.einsum("mp,np,kni->kmi", cubic, cubic, parts))


def _velocity_change(walk: Foot, still: int) -> float:
    """Rms over mid-stance of the velocity against that at the stillest instant, mm/s, from the force alone."""
    reach = round(MID_STANCE_S / walk.period_s)
    near = slice(still - reach, still + reach + 1)
    force = np.einsum("nij,nj->ni", walk.nav_R_foot[near], walk.force[near]) - [0.0, 0.0, GRAVITY_M_S2]
    velocity = np.cumsum(force, axis=0) * walk.period_s
    return float(1e3 * np.sqrt(((velocity - velocity[reach]) ** 2).sum(axis=1).mean()))


def _lever_cm(walk: Foot) -> float:
    stances = detect_stances(walk.recording)
    body_up = np.einsum(
        "nij,ni->j", walk.solution.nav_R_body[walk.still], np.tile([0.0, 0.0, 1.0], (len(walk.still), 1))
    )
    return float(100 * estimate_lever(walk.recording, stances).lever @ body_up / np.linalg.norm(body_up))


def _left_over(walk: Foot, begin: int, end: int) -> float:
    """Velocity at the end of a stride that began at rest, mm/s, by strapdown from the smoother's attitude."""
    recording, bias = walk.recording, walk.solution.stances.gyro_bias.mean(axis=0)
    attitude = walk.solution.nav_R_body[begin].copy()
    state = NavState(np.zeros(3), np.zeros(3), attitude, bias, np.zeros(3))
    integrate(state, recording.acc[begin:end], recording.gyr[begin:end], walk.period_s)
    return float(1e3 * np.linalg.norm(state.velocity))


def true_facts(walk: Foot) -> dict[str, float]:
    """`TRUE_FACTS` of a walk whose truth is known at every sample."""
    truth = walk.recording.truth
    assert isinstance(truth, TrajectoryTruth)
    t = walk.recording.t
    place = np.stack([np.interp(t, truth.t, axis) for axis in truth.position.T], axis=1)
    velocity = _smoothed_slope(place, walk.period_s)
    reach = round(MID_STANCE_S / walk.period_s)
    still = walk.strides[1:, 0]
    speed = np.linalg.norm(velocity, axis=1)
    way = np.array([place[j] - place[i] for i, j in walk.strides[1:]])[:, :2]
    ahead = way / np.linalg.norm(way, axis=1)[:, None]
    return {
        "speed": float(1e3 * np.median(speed[still])),
        "speed_rms": float(1e3 * np.median([np.sqrt(np.mean(speed[i - reach : i + reach] ** 2)) for i in still])),
        "forward": float(1e3 * np.median((velocity[still, :2] * ahead).sum(axis=1))),
        "sinking": float(-1e3 * np.median(velocity[still, 2])),
        "captured_rate_deg_s": float(np.median(np.linalg.norm(walk.rate[still], axis=1))),
    }


def _smoothed_slope(place: Floats, period_s: float, reach: int = 4) -> Floats:
    """Velocity (N, 3) as the slope of a line through 2 reach + 1 positions: motion capture trembles by 0.1 mm."""
    offsets = np.arange(-reach, reach + 1)
    kernel = offsets[::-1] / (period_s * (offsets**2).sum())
    return np.stack([np.convolve(axis, kernel, mode="same") for axis in place.T], axis=1)


if __name__ == "__main__":
    harness.run(main)
