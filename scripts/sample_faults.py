"""Bad samples in real walks: what is found of them, and how far the end of the walk moves.

    python scripts/sample_faults.py [faults] [--sensor gyr|acc] [--sizes SIZE ...] [--lengths N ...] [--tries N]
                                    [--walks NAME ...] [--methods NAME ...] [--first SEED] [--data DIR] [--jobs N]
    python scripts/sample_faults.py clean [--data DIR]

faults
    Each try draws a place in a walk, an axis, a sign, and how the samples go wrong: some is added to them, or they are
    that size, or some with a sign of its own is added to each. All sizes are tried at the same places. The walk is
    navigated as a user does, without the magnetometer, and the end compared with that of the walk without the fault.
    "beyond" counts the tries in which it moved by more than 0.3 m or 3 of the sigmas claimed, on any axis. Of each of
    these it is said how far the end moves where what was bridged is what was read, with the sigma of the bridge, and
    where it is off that by one such sigma, on the worst axis; and with the samples left out as a gap.

clean
    Every real recording as it is: how many samples are found at f as it is, and at which share of f the first would be
    (`fg_nav.samples.readings`); at 100 and 50 Hz too, samples picked out.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from unittest import mock

import harness
import numpy as np
from harness import FIRST_SEED, option
from verdicts import SEGMENTS, read_segment
from walks import GDIN_WALKS, GDLBIO_RUN, GDLBIO_WALKED, LOOPS, RUNNING, data_folder, gdin_path, gdlbio_path

from fg_nav.arrays import Bools, Floats, Ints
from fg_nav.errors import FgNavError
from fg_nav.io import read
from fg_nav.pipeline import navigate
from fg_nav.recording import RawRecording, Recording
from fg_nav.samples.gaps import Bridge
from fg_nav.samples.readings import FACTOR, find_outliers
from fg_nav.walk import Options

FEW = ("gdin 31", "gdin 36", "gdlbio 62", "vicon 2017-11-22-11-35-59")
ALL = (
    *(f"gdin {number}" for number in (18, 20, 22, 29, 31, 33, 36, 40)),
    *(f"gdlbio {number}" for number in (58, 62, 80)),
    "vicon 2017-11-22-11-35-59",
    "vicon 2017-11-27-11-12-44",
    "openshoe 7",
)
"""14 walks, walked and run, of four sets."""

EDGE = 20  # Samples from the first and the last one; a fault at the very end moves nothing.

MAX_M, MAX_SIGMAS = 0.3, 3.0

SIZES = {"gyr": [30.0, 100.0, 300.0], "acc": [200.0, 1000.0]}

SHARES = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print one of the two."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        what=option("faults", "what to measure", choices=("faults", "clean"), nargs="?", positional=True),
        sensor=option("gyr", "that reads wrongly", choices=tuple(SIZES)),
        sizes=option(None, "rad/s or m/s^2", nargs="+", type=float),
        lengths=option([1, 5], "samples in a row", nargs="+", type=int),
        tries=option(4, "places in each walk", metavar="N"),
        walks=option(FEW, "or all", nargs="+"),
        methods=option(["smoother", "iez"], "of estimation", nargs="+"),
        first=option(FIRST_SEED, "seed", metavar="SEED"),
        data=None,
        jobs=1,
    )
    data = data_folder(chosen.data)
    if chosen.what == "clean":
        print_clean(data)
    else:
        print_faults(chosen, data)


# --- faults ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Fault:
    """Samples that go wrong: `values` (n, 3) stand in place of those of a sensor from sample `at` on."""

    size: float
    length: int
    at: int
    values: Floats


@dataclass(frozen=True)
class Moved:
    """What a fault did, so far into a walk: share of it that was found, good samples too, by how much the end moved."""

    walk: str
    at_s: float
    method: str
    size: float
    length: int
    found: float
    others: int
    moved_m: float
    sigmas: float
    bound: str = ""


def draw_faults(samples: Floats, sizes: Sequence[float], length: int, rng: np.random.Generator) -> Iterator[Fault]:
    """Draw a place, and a fault of each size at it."""
    at, axis = int(rng.integers(EDGE, len(samples) - EDGE - length)), int(rng.integers(3))
    sign, kind = rng.choice([-1.0, 1.0], length), int(rng.integers(3))
    for size in sizes:
        values = samples[at : at + length].copy()
        added = size * (sign if kind == 2 else sign[0])
        values[:, axis] = added if kind == 1 else values[:, axis] + added
        yield Fault(size, length, at, values)


def spoil(clean: Recording, sensor: str, fault: Fault) -> RawRecording:
    """Return the samples with a fault, not yet judged."""
    acc, gyr = clean.acc.copy(), clean.gyr.copy()
    (gyr if sensor == "gyr" else acc)[fault.at : fault.at + fault.length] = fault.values
    return RawRecording(clean.t, acc, gyr, np.arange(1, len(clean) + 1))


def find_lost(clean: Recording, judged: Recording) -> Bools:
    """Which samples (N,) of a clean recording were found to be bad, of one sensor or both."""
    lost = np.isin(clean.t, judged.t, invert=True)
    if judged.unread is not None:
        lost |= np.isin(clean.t, judged.t[judged.unread > 0])
    return np.asarray(lost)


def find_end(recording: Recording, method: str) -> tuple[Floats, Floats]:
    """Place of the last footfall, m, and its sigmas, (3,) each."""
    solution = navigate(recording, method, options=Options(use_magnetometer=False))
    return solution.stances.position[-1], solution.stances.position_sigma[-1]


def measure_bound(clean: Recording, judged: Recording, end: Floats, method: str) -> str:
    """What can be asked of a bridge: by how much the end moves with the true one, one a sigma off, and with a gap."""
    unread = np.zeros(len(judged), dtype=np.bool_) if judged.unread is None else judged.unread > 0
    if not unread.any() or len(judged) != len(clean):
        return ""
    true = [
        bridge._replace(value=samples[bridge.sample])
        for bridge, samples in zip(judged.bridges, (clean.acc, clean.gyr), strict=True)
    ]
    shifts = [np.zeros(3), *np.eye(3)]
    moved = []
    for shift in shifts:
        off = [one._replace(value=one.value + shift * one.sigma / np.sqrt(max(len(one.sample), 1))) for one in true]
        with bridge_with(judged.t, off):
            moved.append(float(np.linalg.norm(find_end(replace(judged), method)[0] - end)))
    kept = ~unread
    gap = Recording(clean.t[kept], clean.acc[kept], clean.gyr[kept])
    left_out = float(np.linalg.norm(find_end(gap, method)[0] - end))
    return f"; bridged exactly {moved[0]:.3f} m, a sigma off up to {max(moved[1:]):.3f} m, as a gap {left_out:.3f} m"


@contextmanager
def bridge_with(t: Floats, bridges: Sequence[Bridge]) -> Iterator[None]:
    """Put these in place of what would be learned, in all parts of a recording of stamps `t` (N,)."""

    def look_up(part_t: Floats, acc: Floats, gyr: Floats, unread: Ints | None) -> tuple[Bridge, Bridge]:
        start, stop = np.searchsorted(t, [part_t[0], part_t[-1]])
        of_acc, of_gyr = (one.within(int(start), int(stop) + 1) for one in bridges)
        return of_acc, of_gyr

    with mock.patch("fg_nav.recording.bridge_unread", look_up):
        yield


def try_walk(chosen: argparse.Namespace, data: Path, name: str) -> list[Moved]:
    """Try all faults on a walk; where two leave the same samples, it is navigated once."""
    clean = replace(read(find_path(name, data)), mag=None, truth=None)
    sizes = chosen.sizes or SIZES[chosen.sensor]
    samples = clean.gyr if chosen.sensor == "gyr" else clean.acc
    ends = {method: find_end(clean, method) for method in chosen.methods}
    moved = []
    for seed in range(chosen.first, chosen.first + chosen.tries):
        for length in chosen.lengths:
            rng = np.random.default_rng([seed, length, *name.encode()])
            known: dict[tuple[str, bytes], tuple[Floats, Floats]] = {}
            for fault in draw_faults(samples, sizes, length, rng):
                judged = Recording.from_raw(spoil(clean, chosen.sensor, fault))
                lost = find_lost(clean, judged)
                within = int(lost[fault.at : fault.at + length].sum())
                for method in chosen.methods:
                    key = method, judged.acc.tobytes() + judged.gyr.tobytes() + lost.tobytes()
                    end, sigma = known.get(key) or known.setdefault(key, find_end(judged, method))
                    off = np.abs(end - ends[method][0])
                    most = float((off / sigma).max())
                    others = int(lost.sum()) - within
                    size = float(np.linalg.norm(off))
                    at_s = float(clean.t[fault.at] - clean.t[0])
                    one = Moved(name, at_s, method, fault.size, length, within / length, others, size, most)
                    if is_beyond(one):
                        one = replace(one, bound=measure_bound(clean, judged, ends[method][0], method))
                    moved.append(one)
    return moved


def print_faults(chosen: argparse.Namespace, data: Path) -> None:
    """Print one row a method, length and size."""
    names = ALL if list(chosen.walks) == ["all"] else chosen.walks
    walks = harness.map_walks(partial(try_walk, chosen, data), names, chosen.jobs)
    every = [one for walk in walks for one in walk]
    harness.print_heading(f"{len(names)} walks, {chosen.tries} places in each: the end moves by")
    rows = []
    for key in sorted({(one.method, one.length, one.size) for one in every}):
        some = [one for one in every if (one.method, one.length, one.size) == key]
        beyond = sum(map(is_beyond, some))
        worst_m, worst_sigmas = max(one.moved_m for one in some), max(one.sigmas for one in some)
        whole = sum(one.found == 1.0 for one in some)
        tail = [
            str(sum(one.others for one in some)),
            f"{worst_m:.3f}",
            f"{worst_sigmas:.2f}",
            f"{beyond} of {len(some)}",
        ]
        rows.append([key[0], str(key[1]), f"{key[2]:g}", f"{whole} of {len(some)}", *tail])
    harness.print_table(("method", "samples", "size", "found", "others", "worst, m", "worst, sigmas", "beyond"), rows)
    for one in filter(is_beyond, every):
        moved = f"{one.moved_m:.3f} m, {one.sigmas:.2f} sigmas"
        where = f"{one.walk} at {one.at_s:.2f} s"
        print(f"{one.method}, {where}, {one.length} of {one.size:g}, {one.found:.0%} found: {moved}{one.bound}")


def is_beyond(one: Moved) -> bool:
    """Whether the end moved by more than is allowed."""
    return one.moved_m > MAX_M or one.sigmas > MAX_SIGMAS


def find_path(name: str, data: Path) -> Path:
    """File of a walk by its name."""
    group, _, number = name.partition(" ")
    if group == "vicon":
        return data / "vicon" / f"{number}.mat"
    if name in LOOPS:
        return data / LOOPS[name]
    return gdin_path(data, int(number)) if group == "gdin" else gdlbio_path(data, int(number))


# --- clean -----------------------------------------------------------------------------------------------------------


TWO_FEET = {
    "two_feet/zupt_fgo/imuMeas*.csv": ("acc=acc_x:acc_y:acc_z,gyr=gyro_x:gyro_y:gyro_z", 60.0),
    "two_feet/gaitmap/imu_sample_ms_*.csv": ("acc=acc_x:acc_y:acc_z,gyr=gyr_x:gyr_y:gyr_z[deg/s]", 204.8),
}
"""Columns, and rate in Hz, of files that say neither."""


def list_recordings(data: Path) -> Iterator[tuple[str, Recording]]:
    """Read every real recording, of feet, legs, hands and the rest of a body."""
    folders = [data / name for name in ("vicon", "broad", "ridi_leg")]
    paths = [path for folder in folders for path in sorted(folder.glob("*")) if path.suffix in (".mat", ".csv")]
    paths += [gdin_path(data, number) for number in (*GDIN_WALKS, *RUNNING)]
    paths += [gdlbio_path(data, number) for number in (*GDLBIO_WALKED, *GDLBIO_RUN)]
    paths += [data / path for path in LOOPS.values()]
    loads: list[tuple[str, Callable[[], Recording]]] = [(f"{p.parent.name}/{p.stem}", partial(read, p)) for p in paths]
    for pattern, (columns, rate_hz) in TWO_FEET.items():
        of_file = partial(read, columns=columns, rate_hz=rate_hz)
        loads += [(f"two_feet/{path.stem}", partial(of_file, path)) for path in sorted(data.glob(pattern))]
    loads += [(f"qmt/{one}", lambda one=one: Recording.from_raw(read_segment(data, one))) for one in SEGMENTS]
    for name, load in loads:
        try:
            yield name, load()
        except FgNavError as error:
            print(f"{name}: {error}")


def print_clean(data: Path) -> None:
    """Print what is found in recordings without a fault."""
    rows = []
    for name, recording in list_recordings(data):
        told = sum("bad sample" in note for note in recording.provenance.notes)
        counts = [count_found(recording, each, 1.0) for each in (1, 2, 4)]
        shares = [max((s for s in SHARES if count_found(recording, each, s)), default=0.0) for each in (1, 2, 4)]
        words = [f"{share:g}" if share else f"< {SHARES[-1]:g}" for share in shares]
        rows.append([name, f"{1 / recording.period_s:.0f}", str(told), *map(str, counts), *words])
    harness.print_heading("Samples found in recordings as they are, and the share of f at which the first is")
    rates = ("whole", "half", "quarter")
    harness.print_table(("recording", "Hz", "told", *rates, *(f"first, {rate}" for rate in rates)), rows)
    print(f"{sum(int(row[3]) + int(row[2]) for row in rows)} found in {len(rows)} recordings")


def count_found(recording: Recording, each: int, share: float) -> int:
    """Count the samples that are found at a share of f, where one sample in `each` is taken."""
    t, acc, gyr = (some[::each] for some in (recording.t, recording.acc, recording.gyr))
    return int(np.count_nonzero(find_outliers(t, acc, gyr, FACTOR * share)))


if __name__ == "__main__":
    harness.run(main)
