"""Recordings for the verdict: good walks, and such as are no walk or were spoiled; real ones and simulated ones.

============== ====================================================================================================
good           vicon (ordinary trials), gdin, gdlbio walked, openshoe, xio; simulated walks
by hand        BROAD: a sensor that is turned and moved by hand, with and without breaks
crawling       vicon 2018-02-09: crawling and ladders
worn elsewhere qmt_fullbody: thigh, hand, forearm, head, hip; a phone in a trouser leg
clipped        real walks with gyroscope and accelerometer cut at half of the largest reading
20 Hz          real walks, one sample in ten (of 250 Hz, twelve)
loose          a simulated sensor that turns on the shoe by some degrees in every swing and rings after it
wrong axes     real walks with the gyroscope negated, two axes exchanged, or one negated
============== ====================================================================================================

A spoiled recording goes through the door of a file (`Recording.from_raw`) and may be refused there.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

import harness
import numpy as np
import scipy.io
import walks
from harness import Figure
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.io import read_raw
from fg_nav.lab.simulation import simulate
from fg_nav.recording import RawRecording, Recording

CRAWLING = ("2018-02-09",)
"""Days of vicon trials that are no ordinary walk."""

SIMULATED, FIRST_SEED = 7, 301


@dataclass(frozen=True)
class Case:
    """A recording that is read or made when it is asked for."""

    kind: str
    name: str
    load: Callable[[], RawRecording]

    @property
    def is_good(self) -> bool:
        """Whether it is an ordinary walk."""
        return self.kind == GOOD


GOOD = "good"


def list_cases(data: Path) -> list[Case]:
    """All recordings, good ones first."""
    return [*_good(data), *_not_walked(data), *_spoiled(data)]


def _good(data: Path) -> Iterator[Case]:
    for name, path in _real_walks(data):
        yield Case(GOOD, name, partial(_read, path))
    for seed in range(SIMULATED):
        yield Case(GOOD, f"simulated {FIRST_SEED + seed}", partial(_simulate, FIRST_SEED + seed))


def _real_walks(data: Path) -> Iterator[tuple[str, Path]]:
    for path in sorted((data / "vicon").glob("*.mat")):
        if not path.stem.startswith(CRAWLING):
            yield f"vicon {path.stem}", path
    for number in (*walks.GDIN_WALKS, *walks.RUNNING):
        yield f"gdin {number}", walks.gdin_path(data, number)
    for number in walks.GDLBIO_WALKED:
        yield f"gdlbio {number}", walks.gdlbio_path(data, number)
    for name, path in walks.LOOPS.items():
        yield name, data / path


def _not_walked(data: Path) -> Iterator[Case]:
    for path in sorted((data / "broad").glob("*.mat")):
        yield Case("by hand", path.stem, partial(_read, path))
    for path in sorted((data / "vicon").glob("2018-02-09*.mat")):
        yield Case("crawling", path.stem, partial(_read, path))
    for segment in SEGMENTS:
        yield Case("worn elsewhere", segment, partial(read_segment, data, segment))
    yield Case("worn elsewhere", "trouser leg", partial(_read, data / "ridi_leg" / "zhicheng_leg2.csv"))


def _spoiled(data: Path) -> Iterator[Case]:
    known = dict(_real_walks(data))
    some = [known[name] for name in list(known)[::8]]
    for path in some[:6]:
        yield Case("clipped", path.stem, partial(_spoil, partial(_read, path), partial(clip, share=0.5)))
    for path in some[:6]:
        yield Case("20 Hz", path.stem, partial(_spoil, partial(_read, path), partial(thin_out, rate_hz=20.0)))
    for seed in range(6):
        walk = partial(_simulate, FIRST_SEED + seed)
        yield Case("loose", f"simulated {FIRST_SEED + seed}", partial(_spoil, walk, partial(loosen, seed=seed)))
    changes = {
        "gyroscope negated": -np.eye(3),
        "x and y exchanged": np.eye(3)[[1, 0, 2]],
        "z negated": np.diag([1.0, 1.0, -1.0]),
    }
    for path, (name, change) in zip(some[:6], [*changes.items()] * 2, strict=True):
        turned = partial(_spoil, partial(_read, path), partial(turn_gyr, change=change))
        yield Case("wrong axes", f"{path.stem}, {name}", turned)


# --- judging them ----------------------------------------------------------------------------------------------------


class Judged(Protocol):
    """What becomes of one of them."""

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""


Found = TypeVar("Found", bound=Judged)
Item = TypeVar("Item")


def judge_by_methods(
    judge: Callable[[Item, str], Found],
    items: Sequence[Item],
    methods: Sequence[str],
    chosen: argparse.Namespace,
    print_counts: Callable[[str, Sequence[Found], bool], None],
    judge_counts: Callable[[str, Sequence[Found]], list[Figure]],
) -> None:
    """Judge all items by each method, print, and write what was asked for."""
    figures: list[Figure] = []
    found: list[Found] = []
    for method in methods:
        judged = harness.map_walks(partial(_judge_by, judge, method), items, chosen.jobs, title=method)
        print_counts(method, judged, chosen.per_walk)
        figures += judge_counts(method, judged)
        found += judged
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json, verdicts=[one.as_dict() for one in found])


def _judge_by(judge: Callable[[Item, str], Found], method: str, item: Item) -> Found:
    return judge(item, method)


# --- making them -----------------------------------------------------------------------------------------------------


def _read(path: Path) -> RawRecording:
    return replace(read_raw(path), mag=None)


def _spoil(load: Callable[[], RawRecording], change: Callable[[RawRecording], RawRecording]) -> RawRecording:
    return change(load())


SEGMENTS = ("upper_leg_left", "upper_leg_right", "hand_right", "forearm_left", "head", "hip")
"""Of a body, with a sensor each."""


def read_segment(data: Path, name: str) -> RawRecording:
    """Read the walk of a segment of `qmt_fullbody`."""
    body = scipy.io.loadmat(data / "qmt_fullbody" / "full_body_example_data.mat", simplify_cells=True)
    within = (body["t"] >= 40.0) & (body["t"] <= 140.0)
    t = body["t"][within]
    acc, gyr = (np.asarray(body[name][sensor], dtype=np.float64)[within] for sensor in ("acc", "gyr"))
    return RawRecording(t - t[0], acc, gyr, np.arange(len(t)))


def _simulate(seed: int) -> RawRecording:
    return _raw(simulate("demo", seed).recording)


def _raw(recording: Recording) -> RawRecording:
    row = np.arange(len(recording))
    return RawRecording(recording.t, recording.acc, recording.gyr, row, truth=recording.truth)


def clip(raw: RawRecording, share: float) -> RawRecording:
    """Cut acc and gyr at a share of the largest reading of any axis."""
    cut = {name: np.clip(v, -share * np.abs(v).max(), share * np.abs(v).max()) for name, v in
           (("acc", raw.acc), ("gyr", raw.gyr))}  # fmt: skip
    return replace(raw, **cut)


def thin_out(raw: RawRecording, rate_hz: float) -> RawRecording:
    """Keep the samples of a sensor at this rate, each the reading of an instant."""
    step = max(1, round(1.0 / (rate_hz * float(np.median(np.diff(raw.t))))))
    kept = np.s_[::step]
    return replace(raw, t=raw.t[kept], acc=raw.acc[kept], gyr=raw.gyr[kept], row=raw.row[kept])


def turn_gyr(raw: RawRecording, change: Floats) -> RawRecording:
    """Give the gyroscope other axes than the accelerometer."""
    return replace(raw, gyr=raw.gyr @ change.T)


SLACK_RAD, RING_HZ, RING_S = np.radians(8.0), 9.0, 0.15
"""How far a loose sensor turns on the shoe in a swing, and how it rings when the foot comes down."""


def loosen(raw: RawRecording, seed: int) -> RawRecording:
    """Let the sensor turn on the shoe: to another angle within its slack in each swing, ringing as it comes to rest."""
    rng = np.random.default_rng(seed)
    stances = detect_stances(Recording.from_raw(raw))
    slack = np.zeros((len(raw.t), 3))
    angle = np.zeros(3)
    for start, stop in zip(stances.stop[:-1], stances.start[1:], strict=True):
        target = SLACK_RAD * rng.uniform(-1.0, 1.0, 3)
        share = np.linspace(0.0, 1.0, stop - start)[:, None]
        slack[start:stop] = angle + (target - angle) * (3 - 2 * share) * share**2
        slack[stop:] = target
        late = raw.t[stop:] - raw.t[stop]
        ring = 0.5 * SLACK_RAD * np.exp(-late / RING_S) * np.sin(2 * np.pi * RING_HZ * late)
        slack[stop:] += ring[:, None] * rng.uniform(-1.0, 1.0, 3)
        angle = target
    body_R_loose = Rotation.from_rotvec(slack)
    step = (body_R_loose[:-1].inv() * body_R_loose[1:]).as_rotvec() / np.diff(raw.t)[:, None]
    gyr = body_R_loose.inv().apply(raw.gyr) + np.vstack([step, np.zeros(3)])
    return replace(raw, acc=body_R_loose.inv().apply(raw.acc), gyr=gyr)
