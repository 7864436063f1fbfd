"""A sensor in a trouser pocket: how fast its gyro bias is found, and phones in real pockets beside GNSS."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import walks
from harness import option

from experiments import Asked, Column, Experiment, Figures, Found, Task, attempt, find_truth, list_seeds
from fg_nav.arrays import Bools, Floats
from fg_nav.frames import yaw_rotation
from fg_nav.io import read, read_gnss
from fg_nav.lab.follow_pocket import follow_pocket
from fg_nav.lab.reproduce.munoz_diaz2017.walks import FIELDS_UT, replace_field
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.lab.simulation.fields import Field, Homogeneous, street
from fg_nav.pipeline import navigate
from fg_nav.pocket import (
    PocketParameters,
    PocketSmootherParameters,
    PocketStart,
    PocketTrack,
    estimate_pocket,
    smooth_pocket,
)
from fg_nav.recording import Recording
from fg_nav.truth import FixColumns, Gnss, find_turn
from fg_nav.walk import Options, Walk

# --- gyro bias -------------------------------------------------------------------------------------------------------

WITHIN_DEG_S, FROM_S, STREET_M = 0.02, 60.0, 500.0
AFTER_S = (60, 2300)
FIELDS = ("equator", "munich", "street", "past-cars")


def list_biases(chosen: Namespace) -> list[Task]:
    """The walks of each seed in each field."""
    return list_seeds(chosen, {name: partial(find_bias, name, chosen.noise) for name in FIELDS})


def find_bias(name: str, noise_uT: float, seed: int) -> Found:
    """What each method, given the noise of the magnetometer, finds in a field."""
    if name == "past-cars":
        walk = simulate("pocket-past-cars", seed)
        field: Field = walk.field
    else:
        walk = simulate("pocket-street", seed, Choices(aligned=True))
        field = Homogeneous(FIELDS_UT["equator" if name == "street" else name])
        field = street(field, STREET_M) if name == "street" else field
    recording = replace_field(walk, field, noise_uT, np.random.default_rng((seed, FIELDS.index(name))))
    nav_R_body = find_truth(recording)[1]
    start, last = PocketStart(nav_R_body[0], math.radians(0.5)), nav_R_body[-1]
    graph, paper = PocketSmootherParameters(mag_sigma_uT=noise_uT), PocketParameters(mag_sigma_uT=noise_uT)
    methods: Mapping[str, Callable[[], PocketTrack]] = {
        "online": lambda: follow_pocket(recording, graph, start),
        "batch": lambda: smooth_pocket(recording, graph, start),
        "paper": lambda: estimate_pocket(recording, paper, start),
    }

    def judge(run: Callable[[], PocketTrack]) -> Figures:
        track = run()
        off = track.gyro_bias - np.stack([np.interp(track.t, walk.biases.t, x) for x in walk.biases.gyr.T], axis=1)
        # the error of the z bias each second, and from when on it is within what is asked for good
        z = np.degrees(off[np.searchsorted(track.t, np.arange(track.t[0], track.t[-1], 1.0)), 2])
        outside = np.flatnonzero(~(np.abs(z) <= WITHIN_DEG_S))
        since = float(outside[-1] + 1) if len(outside) else 0.0
        turn = track.nav_R_body[-1] @ last.T
        yaw = math.degrees(math.atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]))
        kept = track.t[track.covariance_sample] >= FROM_S
        e, P = off[track.covariance_sample[kept]], track.covariance[kept, 3:, 3:]
        nees = float(np.einsum("ni,ni->n", e, np.linalg.solve(P, e[:, :, None])[:, :, 0]).mean())
        after = {f"{s} s": float(z[min(s, len(z) - 1)]) for s in AFTER_S}
        return {**after, "found (s)": since if since < len(z) else math.inf, "yaw (deg)": yaw, "NEES of 3": nees}

    return {method: attempt(partial(judge, run)) for method, run in methods.items()}


# --- real pockets and thighs -----------------------------------------------------------------------------------------

MAX_ACCURACY_M, DECLINATION_DEG = 15.0, -6.0  # Of a fix; of magnetic north, where the phones were carried.
POCKET = Options(mount="pocket")


def list_pockets(chosen: Namespace) -> list[Task]:
    """Phones in trouser pockets outdoors."""
    data = walks.data_folder(chosen.data)
    phones = sorted((data / "pocket_gnss").glob("*.zip"))
    return [Task("pockets", path.stem.removeprefix("pocket_"), partial(measure_pocket, path)) for path in phones]


def measure_pocket(path: Path) -> Found:
    """Figures of one phone."""
    recording, everything = read(path), read_gnss(path)
    kept = tuple(fix for fix in everything.fixes if fix.horizontal_sigma_m < MAX_ACCURACY_M)
    gnss, t = replace(everything, fixes=kept), np.array([fix.time_s for fix in kept])
    place, sigma = np.array([fix.position[:2] for fix in kept]), np.array([fix.horizontal_sigma_m for fix in kept])
    first, half, minute = t < t[0] + 0.1 * (t[-1] - t[0]), np.arange(len(t)) % 2 == 0, (t // 30.0) % 2 == 0

    def distance(path: Floats, where: Bools) -> float:
        return float(np.linalg.norm(path - place, axis=1)[where].mean())

    def by_sensor() -> Figures:
        walked, metres, _ = solve(recording, None, t)
        given = FixColumns(t[first], place[first], sigma[first])
        turn, shift = find_turn(walked[first], given)
        north = walked @ yaw_rotation(np.radians(-DECLINATION_DEG))[:2, :2].T
        middle = np.median((place - north)[first], axis=0)
        return {
            "metres": metres / float(np.linalg.norm(np.diff(place[::5], axis=0), axis=1).sum()),
            "rigid (m)": distance(walked @ yaw_rotation(turn)[:2, :2].T + shift, ~first),
            "north (m)": distance(north + middle, ~first),
        }

    def by_fixes() -> Figures:
        found = dict[str, float]()
        for name, used in (("first (m)", first), ("held (m)", half), ("30 s (m)", minute)):
            some = replace(gnss, fixes=tuple(fix for fix, use in zip(kept, used, strict=True) if use))
            fused, _, start = solve(recording, some, t)
            found[name] = distance(fused + start, ~used)
        return found

    return {"sensor": attempt(by_sensor), "with fixes": attempt(by_fixes)}


def solve(recording: Recording, gnss: Gnss | None, at: Floats) -> tuple[Floats, float, Floats]:
    """Places (K, 2) m from the start at times (K,) s, the metres walked, and the start (2,) m in the fixes' axes."""
    from pymap3d import geodetic2enu

    found = navigate(replace(Walk.of(recording, POCKET), gnss=gnss), "pocket")
    place = np.stack([np.interp(at, found.t, axis) for axis in found.position[:, :2].T], axis=1)
    if gnss is None:
        return place, found.metrics.distance_m, np.zeros(2)
    start = found.parameters["gnss_start"]
    assert isinstance(start, dict)
    degrees = start["latitude_deg"], start["longitude_deg"]
    east, north, _ = geodetic2enu(*degrees, 0.0, gnss.latitude_deg, gnss.longitude_deg, 0.0)
    return place, found.metrics.distance_m, np.array([east, north])


EXPERIMENTS: Mapping[str, Experiment] = {
    "pocket-bias": Experiment(
        """How fast a gyro bias is found in a trouser pocket, and how far off the heading is after 39 minutes
        (simulated).

        The 3 km of `pocket-street` with the errors of Table 2 of Munoz Diaz et al. (2017), biases of 0.1 deg/s not
        given, in the fields of their Table 1; `street`: lamps and parked cars in every block; `past-cars`: as in their
        Figures 7b and 10. Error of the z bias after so many seconds, deg/s; found: from when on it stays within 0.02
        deg/s for good.""",
        list_biases,
        (
            *(Column(f"{s} s", f"{s} s", "median / p95", "{:.4f}") for s in AFTER_S),
            Column("found (s)", "found (s)", pattern="{:.0f}"),
            Column("yaw (deg)", "yaw (deg)", pattern="{:.2f}"),
            Column("NEES of 3", "NEES of 3", "mean", "{:.1f}"),
        ),
        [
            Asked(figure, "median", high=high, section=name, variant=variant)
            for name, found, yaw in (("equator", 60, 3), ("munich", 60, 3), ("street", 300, 6), ("past-cars", 300, 6))
            for figure, variant, high in (
                ("found (s)", "online", found),
                ("yaw (deg)", "online", yaw),
                ("yaw (deg)", "batch", yaw),
            )
        ],
        seeds=20,
        options={"noise": option(0.5, "of the magnetometer, uT a sample", metavar="UT")},
    ),
    "real-pockets": Experiment(
        """Phones in real trouser pockets beside GNSS: how far, which way, how near.

        Metres over the way along the fixes. Mean distances, m, to the fixes of
        the last 90 %: the path laid on those of the first 10 % (rigid), the same by the compass and a shift (north),
        those fixes given (first); to every second fix, or second half minute, the others given (held, 30 s).""",
        list_pockets,
        tuple(
            Column(name, name, "median / worst", "{:.2f}")
            for name in ("metres", "rigid (m)", "north (m)", "first (m)", "held (m)", "30 s (m)")
        ),
    ),
}
