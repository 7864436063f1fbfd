"""Verdicts on recordings that are walks, with the error of their paths, and on such as are no walk or were spoiled.

    python scripts/verdicts.py [--data DIR] [--methods NAME ...] [--kinds KIND ...] [--every NTH] [--lines] [--per-walk]
                               [--jobs N] [--json FILE]

============== ====================================================================================================
good           vicon (ordinary trials), gdin, gdlbio walked, openshoe, xio; simulated walks
others         mti1_loops, mems_foot, mtig710 and corridor_lab, whatever their sensor, run and clipped gdlbio
by hand        BROAD: a sensor that is turned and moved by hand, with and without breaks
crawling       vicon 2018-02-09: crawling and ladders
worn elsewhere qmt_fullbody: thigh, hand, forearm, head, hip; a phone in a trouser leg
clipped        real walks with gyroscope and accelerometer cut at half of the largest reading
20 Hz          real walks, one sample in ten (of 250 Hz, twelve)
loose          a simulated sensor that turns on the shoe by some degrees in every swing and rings after it
wrong axes     real walks with the gyroscope negated, two axes exchanged, or one negated
high-passed    mems_foot `lap_high_passed`
============== ====================================================================================================

A spoiled recording goes through the door of a file (`Recording.from_raw`) and may be refused there. The magnetometer is
left out. The error is that of the end, over the ground: from the truth, or of a walk that ends where it began from the
start. Asked: of the walks that are off by a tenth of the way or three sigmas none trusted, of the good ones 95 in 100
trusted, of mti1_loops 18 of 24 and 1 not to be used at most, of those that are no walk or were spoiled 95 in 100 not
trusted. Clipped walks are judged by their error.

With `--lines` the recordings go as rows through `follow`, and each line has its verdict. Lines that are doubtful
because little was walked are as they should be, and counted apart. Asked of good walks: none refused, none with a line
that is not to be used, one in twenty at most with a line that is doubtful for another reason.
"""

from __future__ import annotations

import argparse
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

import harness
import numpy as np
import scipy.io
import walks
from harness import Figure, option
from scipy.spatial.transform import Rotation

from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.errors import FgNavError
from fg_nav.io import read_raw
from fg_nav.lab.simulation import simulate
from fg_nav.online.buffer import OnlineOptions
from fg_nav.online.follow import Sensor, StreamOptions, follow
from fg_nav.online.sources import SampleSource
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import RawRecording, Recording
from fg_nav.verdict import UNUSABLE, judge_path
from fg_nav.view.outlets import Outlets
from fg_nav.walk import Options, Walk

TRUSTED, DOUBTFUL, REFUSED = "trusted", "doubtful", "refused"
BEGINNING = "too little has been walked to know"
WORDS = (TRUSTED, DOUBTFUL, UNUSABLE, REFUSED)
GOOD, CLIPPED, MTI1 = "good", "clipped", "mti1_loops"
WALKED = (GOOD, MTI1, "mems_foot", "mtig710", "corridor_lab", "gdlbio run")
ASKED_SHARE, ASKED_MTI1, ASKED_DOUBTFUL_LINES = 0.95, 18 / 24, 1 / 20
CRAWLING = ("2018-02-09",)  # Days of vicon trials that are no ordinary walk.
CLOSED = ("square", "rectangle", "large", "c_shape", "lap_360", "five_small", "hallway_walk3", "lab_corridor")
SIMULATED, FIRST_SEED = 7, 301


@dataclass(frozen=True)
class Case:
    """A recording that is read or made when it is asked for, and whether it ends where it began."""

    kind: str
    name: str
    load: Callable[[], RawRecording]
    is_closed: bool = False


def list_cases(data: Path) -> list[Case]:
    """All recordings, good ones first."""
    return [*_good(data), *_others(data), *_not_walked(data), *_spoiled(data)]


def _good(data: Path) -> Iterator[Case]:
    for name, path in _real_walks(data):
        yield Case(GOOD, name, partial(_read, path), name in walks.LOOPS)
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


def _others(data: Path) -> Iterator[Case]:
    for path in sorted((data / MTI1).glob("*.csv.gz")):
        yield Case(MTI1, path.name.split(".")[0], partial(walks.read_mti1, path), is_closed=True)
    for number in walks.GDLBIO_RUN:
        yield Case("gdlbio run", f"gdlbio {number}", partial(_read, walks.gdlbio_path(data, number)))
    for folder in ("mems_foot", "mtig710", "corridor_lab"):
        for path in sorted((data / folder).glob("*.csv.gz")):
            name = path.name.removesuffix(".csv.gz")
            if not name.endswith((".baro", ".gnss")) and "still" not in name:
                kind = "high-passed" if name == "lap_high_passed" else folder
                yield Case(kind, name, partial(_read, path), any(word in name for word in CLOSED))


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


@dataclass(frozen=True)
class JudgedPath:
    """A recording by one method: the word, the reasons, and error and sigma of the end and the way, m."""

    kind: str
    name: str
    method: str
    word: str
    reasons: tuple[str, ...]
    error: float = np.nan
    sigma: float = np.nan
    way: float = np.nan

    @property
    def is_wrong(self) -> bool:
        """Whether it is off by three sigmas, and 1 per cent of the way, or by a tenth of the way."""
        return self.error > 3.0 * float(np.hypot(self.sigma, 0.01 * self.way / 3.0)) or self.error > 0.1 * self.way

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        return {**self.__dict__, "reasons": list(self.reasons)}


def judge_case(case: Case, method: str) -> JudgedPath:
    """Estimate a recording by a method, and judge the path."""
    try:
        walk = prepare_walk(Walk.of(Recording.from_raw(case.load()), Options(mount="foot")))
        outcome = run_method(walk, method)
        verdict = judge_path(walk, outcome.solution)
    except FgNavError as error:
        return JudgedPath(case.kind, case.name, method, REFUSED, (str(error),))
    table, end = outcome.solution.stances, outcome.metrics.end_error_m
    closure = float(np.hypot(*(table.position[-1] - table.position[0])[:2])) if case.is_closed else np.nan
    way = float(np.hypot(*np.diff(table.position[:, :2], axis=0).T).sum())
    sigma = float(np.hypot(*table.position_sigma[-1, :2]))
    error = closure if end is None else end
    return JudgedPath(case.kind, case.name, method, verdict.word, verdict.reasons, error, sigma, way)


def print_paths(method: str, judged: Sequence[JudgedPath], per_walk: bool) -> None:
    """Print how many of each kind have which word, their errors, and those that are not as they should be."""
    harness.print_heading(f"Verdicts on the paths of {method}")
    counts = Counter((one.kind, one.word) for one in judged)
    rows = [[kind, *(str(counts[kind, word]) for word in WORDS)] for kind in dict.fromkeys(one.kind for one in judged)]
    harness.print_table(("recordings", *WORDS), rows)
    for title, limits, measure in (
        ("error over way, %", (0.5, 1.0, 2.0, 5.0, 10.0), lambda one: 100 * one.error / max(one.way, 1e-9)),
        ("error over sigma", (0.5, 1.0, 2.0, 3.0, 5.0), lambda one: one.error / max(one.sigma, 1e-9)),
    ):
        rows = []
        for word in WORDS[:-1]:
            values = [measure(one) for one in judged if one.word == word and one.kind in WALKED and one.error >= 0.0]
            below = np.bincount(np.searchsorted(limits, values), minlength=len(limits) + 1)
            rows.append([word, str(len(values)), *map(str, below.tolist())])
        harness.print_table((title, "walks", *(f"< {limit:g}" for limit in limits), "more"), rows)
    for one in judged:
        expected = one.kind in WALKED and not one.is_wrong
        if per_walk or (one.word == TRUSTED) != expected:
            known = f"{one.error:.2f} m off, sigma {one.sigma:.2f}, of {one.way:.0f} m"
            words = f"{one.kind}, {one.name}: {one.word}, {known}: {'; '.join(one.reasons)}"
            harness.console().print(words, soft_wrap=True)


def check_paths(method: str, judged: Sequence[JudgedPath]) -> list[Figure]:
    """Count the good ones that are trusted, the wrong ones that are, and the others that are not."""
    good = [one.word for one in judged if one.kind == GOOD and not one.is_wrong]
    wrong = [one.word for one in judged if one.is_wrong]
    mti1 = [one.word for one in judged if one.kind == MTI1]
    spoiled = [one.word for one in judged if one.kind not in (*WALKED, CLIPPED)]
    figure = partial(Figure, "verdicts", pattern="{:.0f}")
    return [
        figure(f"good walks trusted, of {len(good)}", method, good.count(TRUSTED), ASKED_SHARE * len(good)),
        figure(f"wrong paths trusted, of {len(wrong)}", method, wrong.count(TRUSTED), high=0.0),
        figure(f"mti1_loops trusted, of {len(mti1)}", method, mti1.count(TRUSTED), ASKED_MTI1 * len(mti1)),
        figure(f"mti1_loops not to be used, of {len(mti1)}", method, mti1.count(UNUSABLE), high=1.0),
        figure(f"others not trusted, of {len(spoiled)}", method, len(spoiled) - spoiled.count(TRUSTED),
               ASKED_SHARE * len(spoiled)),
    ]  # fmt: skip


# --- lines of a walk in progress -------------------------------------------------------------------------------------

BLOCK = 256


LINE_WORDS = (TRUSTED, BEGINNING, DOUBTFUL, UNUSABLE, REFUSED)


class RawRows(SampleSource):
    """The rows of a recording as they stand in its file, or of its first `share`."""

    name = "a recording"

    def __init__(self, raw: RawRecording, share: float = 1.0) -> None:
        rows = np.column_stack([raw.t, raw.acc, raw.gyr, np.full((len(raw.t), 3), np.nan)])
        self._rows, self._given = rows[: round(share * len(rows))], 0

    async def read(self) -> Floats | None:
        """See `SampleSource`."""
        first, self._given = self._given, self._given + BLOCK
        return self._rows[first : self._given] if first < len(self._rows) else None


@dataclass(frozen=True)
class JudgedLines:
    """The lines of a walk: how many there are of each word, and the reasons of those that are not trusted."""

    kind: str
    name: str
    words: Counter[str]
    reasons: Counter[str]

    def has(self, word: str) -> bool:
        """Whether a line is of this word."""
        return self.words[word] > 0

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        return {**self.__dict__, "words": dict(self.words), "reasons": dict(self.reasons)}


def judge_lines(case: Case, method: str) -> JudgedLines:
    """Follow a recording, and count the verdicts of its lines; there is one method."""
    lines: list[str] = []
    options = StreamOptions(online=OnlineOptions(use_field=False))
    try:
        follow({None: Sensor(RawRows(case.load()), options)}, Outlets(lines.append, None, lambda words: None))
    except FgNavError as error:
        return JudgedLines(case.kind, case.name, Counter({REFUSED: 1}), Counter({str(error): 1}))
    told = [one for one in map(json.loads, lines) if one["kind"] == "now"]
    words, reasons = Counter[str](), Counter[str]()
    for one in told:
        why = [reason for reason in map(name_reason, one["reasons"]) if reason != BEGINNING]
        has_begun = one["verdict"] != DOUBTFUL or bool(why)
        words[one["verdict"] if has_begun else BEGINNING] += 1
        reasons.update(why if one["verdict"] != TRUSTED else ())
    return JudgedLines(case.kind, case.name, words, reasons)


def name_reason(words: str) -> str:
    """A reason without its figures, so that those of several lines are one."""
    return BEGINNING if words.startswith(BEGINNING) else re.sub(r"[-+]?[0-9][0-9.]*", "#", words)


def print_lines(method: str, judged: Sequence[JudgedLines], per_walk: bool) -> None:
    """Print how many walks of each kind have a line of each word, and why; and the walks that are not as asked."""
    harness.print_heading(f"Lines of walks by {method}: recordings with one of the word, and lines in all")
    rows = []
    for kind in dict.fromkeys(one.kind for one in judged):
        of_kind = [one for one in judged if one.kind == kind]
        having = [
            f"{sum(one.has(word) for one in of_kind)} ({sum(one.words[word] for one in of_kind)})"
            for word in LINE_WORDS
        ]
        rows.append([kind, str(len(of_kind)), *having])
    harness.print_table(("kind", "recordings", *LINE_WORDS), rows)
    for one in judged:
        if per_walk or (one.kind == GOOD and any(one.has(word) for word in (DOUBTFUL, UNUSABLE, REFUSED))):
            why = "; ".join(f"{number} times: {reason}" for reason, number in one.reasons.most_common())
            harness.console().print(f"{one.kind}, {one.name}: {dict(one.words)}: {why}", soft_wrap=True)


def check_lines(method: str, judged: Sequence[JudgedLines]) -> list[Figure]:
    """Good walks that are refused, or have a line against them."""
    good = [one for one in judged if one.kind == GOOD]
    asked = {REFUSED: 0.0, UNUSABLE: 0.0, DOUBTFUL: ASKED_DOUBTFUL_LINES * len(good)}
    return [
        Figure("lines", f"good walks {word}, of {len(good)}", method, sum(one.has(word) for one in good), high=most,
               pattern="{:.0f}")
        for word, most in asked.items()
    ]  # fmt: skip


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


def main(arguments: Sequence[str] | None = None) -> None:
    """Judge all recordings, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        data=None,
        methods=["smoother"],
        kinds=option([], "of recordings; without them all, of lines the good ones", nargs="+", metavar="KIND"),
        every=option(1, "recording is looked at", metavar="NTH"),
        lines=option(False, "judge the lines of a stream"),
        per_walk=False,
        jobs=1,
        json=None,
    )
    cases = list_cases(walks.data_folder(chosen.data))
    kinds = chosen.kinds or ([GOOD] if chosen.lines else {one.kind for one in cases})
    cases = [one for one in cases if one.kind in kinds][:: chosen.every]
    if chosen.lines:
        judge_by_methods(judge_lines, cases, ("stream",), chosen, print_lines, check_lines)
    else:
        judge_by_methods(judge_case, cases, chosen.methods, chosen, print_paths, check_paths)


if __name__ == "__main__":
    harness.run(main)
