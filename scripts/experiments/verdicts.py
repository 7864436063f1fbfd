"""Verdicts on recordings that are walks, with the error of their paths, and on such as are no walk or were spoiled.

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
============== ====================================================================================================

A spoiled recording goes through the door of a file (`Recording.from_raw`) and may be refused there. The error is that
of the end, over the ground: from the truth, or of a walk that ends where it began from the start. A path is wrong where
it is off by a tenth of the way, or by three sigmas and 1 % of the way.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import scipy.io
import walks
from harness import Figure
from scipy.spatial.transform import Rotation

from experiments import Column, Experiment, Figures, Found, Table, Task
from fg_nav.arrays import Floats
from fg_nav.detection import detect_stances
from fg_nav.errors import FgNavError
from fg_nav.lab.simulation import simulate
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import RawRecording, Recording
from fg_nav.verdict import UNUSABLE, judge_path
from fg_nav.walk import Options, Walk

TRUSTED, DOUBTFUL, REFUSED = "trusted", "doubtful", "refused"
WORDS = (TRUSTED, DOUBTFUL, UNUSABLE, REFUSED)
GOOD, CLIPPED, ELSEWHERE, MTI1 = "good", "clipped", "worn elsewhere", "mti1_loops"
WALKED = (GOOD, MTI1, "mems_foot", "mtig710", "corridor_lab", "gdlbio run")
ASKED_SHARE = 0.95
CLOSED = ("square", "rectangle", "large", "c_shape", "lap_360", "five_small", "hallway", "stairs", "lab_corridor",
          "openshoe", "xio")  # fmt: skip
SEGMENTS = ("upper_leg_left", "upper_leg_right", "hand_right", "forearm_left", "head", "hip")
OTHERS: Mapping[str, str] = {
    "mti round": MTI1, "mti stairs": MTI1, "gdlbio run": "gdlbio run", "all of mems": "mems_foot", "mtig": "mtig710",
    "corridor": "corridor_lab", "by hand": "by hand", "crawling": "crawling", "leg": ELSEWHERE,
}  # fmt: skip
"""Kind of each set but the good ones."""
FIRST_SEED = 301

Load = Callable[[], RawRecording]


def list_cases(data: Path) -> Iterator[tuple[str, str, Load]]:
    """Yield kind, name and recording of all, good ones first."""
    simulated = [(f"simulated {seed}", partial(simulate_demo, seed)) for seed in range(FIRST_SEED, FIRST_SEED + 7)]
    sets = ("vicon", "gdin", "running", "gdlbio", "openshoe", "xio")
    real = [one for name in sets for one in walks.list_set(data, name) if not one.name.startswith("2018-02-09")]
    yield from ((GOOD, one.name, one.read_raw) for one in real)
    yield from ((GOOD, name, load) for name, load in simulated)
    for name, kind in OTHERS.items():
        for one in (one for one in walks.list_set(data, name) if "still" not in one.name):
            yield "high-passed" if one.name == "lap_high_passed" else kind, one.name, one.read_raw
    yield from ((ELSEWHERE, segment, partial(read_segment, data, segment)) for segment in SEGMENTS)
    # spoiled ones
    for k, one in enumerate(real[::8][:6]):
        change = (-np.eye(3), np.eye(3)[[1, 0, 2]], np.diag([1.0, 1.0, -1.0]))[k % 3]
        yield CLIPPED, one.name, partial(spoil, clip, one.read_raw)
        yield "20 Hz", one.name, partial(spoil, thin_out, one.read_raw)
        yield "loose", simulated[k][0], partial(spoil, partial(loosen, k), simulated[k][1])
        yield "wrong axes", one.name, partial(spoil, partial(turn_gyr, change), one.read_raw)


def list_verdicts(chosen: Namespace) -> list[Task]:
    """All recordings."""
    cases = list_cases(walks.data_folder(chosen.data))
    return [Task(kind, name, partial(judge_walk, name, load, chosen.methods)) for kind, name, load in cases]


def judge_walk(name: str, load: Load, methods: Sequence[str]) -> Found:
    """Estimate a recording by each method: word, reasons, error and sigma of the end and the way, m."""

    def judge(method: str) -> Figures:
        try:
            walk = prepare_walk(Walk.of(Recording.from_raw(load()), Options(mount="foot")))
            outcome = run_method(walk, method)
            verdict = judge_path(walk, outcome.solution)
        except FgNavError as refusal:
            return {"word": REFUSED, REFUSED: 1, "reasons": str(refusal)}
        table, error = outcome.solution.stances, outcome.metrics.end_error_m
        if error is None and any(word in name for word in CLOSED):
            error = float(np.hypot(*(table.position[-1] - table.position[0])[:2]))
        way = float(np.hypot(*np.diff(table.position[:, :2], axis=0).T).sum())
        sigma = float(np.hypot(*table.position_sigma[-1, :2]))
        wrong = error is not None and (error > 3.0 * np.hypot(sigma, 0.01 * way / 3.0) or error > 0.1 * way)
        return {"word": verdict.word, verdict.word: 1, "error_m": error, "sigma_m": sigma, "way_m": way,
                "wrong": int(wrong), "reasons": "; ".join(verdict.reasons)}  # fmt: skip

    return {method: judge(method) for method in methods}


def judge_verdicts(table: Table) -> list[Figure]:
    """Good ones that are trusted, wrong ones that are, and others that are not."""
    figures = []
    for method in dict.fromkeys(variant for _, variant in table.cases):
        rows = [row for row in table.rows if row["variant"] == method]
        good = [row["word"] for row in rows if row["section"] == GOOD and not row.get("wrong")]
        wrong = [row["word"] for row in rows if row.get("wrong")]
        others = [row["word"] for row in rows if row["section"] not in (*WALKED, CLIPPED)]
        for words, some, low, high in (
            ("good walks", good, ASKED_SHARE, 1.0), ("wrong paths", wrong, 0.0, 0.0),
            ("others", others, 0.0, 1.0 - ASKED_SHARE),
        ):  # fmt: skip
            share = some.count(TRUSTED) / len(some) if some else low
            figures.append(Figure("verdicts", f"{words} trusted, share of {len(some)}", method, share, low, high))
    return figures


# --- making them -----------------------------------------------------------------------------------------------------


def spoil(change: Callable[[RawRecording], RawRecording], load: Load) -> RawRecording:
    """Change a recording where it is read."""
    return change(load())


def read_segment(data: Path, name: str) -> RawRecording:
    """Read the sensor of one segment of the whole body."""
    body = scipy.io.loadmat(data / "qmt_fullbody" / "full_body_example_data.mat", simplify_cells=True)
    within = (body["t"] >= 40.0) & (body["t"] <= 140.0)
    acc, gyr = (np.asarray(body[name][sensor], dtype=np.float64)[within] for sensor in ("acc", "gyr"))
    return RawRecording(body["t"][within] - body["t"][within][0], acc, gyr, np.arange(len(acc)))


def simulate_demo(seed: int) -> RawRecording:
    """Simulate a good walk."""
    recording = simulate("demo", seed).recording
    return RawRecording(recording.t, recording.acc, recording.gyr, np.arange(len(recording)), truth=recording.truth)


def clip(raw: RawRecording) -> RawRecording:
    """Cut acc and gyr at half of the largest reading of any axis."""
    acc, gyr = (np.clip(x, -0.5 * np.abs(x).max(), 0.5 * np.abs(x).max()) for x in (raw.acc, raw.gyr))
    return replace(raw, acc=acc, gyr=gyr)


def thin_out(raw: RawRecording) -> RawRecording:
    """Keep the samples of a sensor of 20 Hz, each the reading of an instant."""
    kept = np.s_[:: max(1, round(1.0 / (20.0 * float(np.median(np.diff(raw.t))))))]
    return replace(raw, t=raw.t[kept], acc=raw.acc[kept], gyr=raw.gyr[kept], row=raw.row[kept])


def turn_gyr(change: Floats, raw: RawRecording) -> RawRecording:
    """Give the gyroscope other axes than the accelerometer."""
    return replace(raw, gyr=raw.gyr @ change.T)


SLACK_RAD, RING_HZ, RING_S = np.radians(8.0), 9.0, 0.15  # Of a loose sensor: how far it turns, and how it rings.


def loosen(seed: int, raw: RawRecording) -> RawRecording:
    """Let the sensor turn on the shoe: to another angle within its slack in each swing, ringing as it comes to rest."""
    rng = np.random.default_rng(seed)
    stances = detect_stances(Recording.from_raw(raw))
    slack, angle = np.zeros((len(raw.t), 3)), np.zeros(3)
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


EXPERIMENTS: Mapping[str, Experiment] = {
    "verdicts": Experiment(
        f"Verdicts on good, spoiled and other recordings, with the errors of their paths.\n\n{__doc__}",
        list_verdicts,
        tuple(Column(word, word, "sum", "{:.0f}") for word in (*WORDS, "wrong")),
        options={"methods": ["smoother"]},
        judge=judge_verdicts,
    )
}
