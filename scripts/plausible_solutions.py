"""What becomes of pieces of walks with wrong axes, signs and scales: refused, named, or taken.

    python scripts/plausible_solutions.py [--data DIR] [--seed N] [--repeats N] [--methods NAME ...] [--jobs N]
                                          [--per-walk] [--json FILE]

From each walk, real ones and simulated, pieces of 4 to 40 s are cut at random, and each is spoiled in one way or none.
Asked: no path that is taken for trusted or doubtful has a speed of 18 m/s or strides at 10 m/s; no piece with its own
axes is refused for them; of pieces with wrong axes, in which a foot makes three strides or more, at least 95 % are
refused or not to be used.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import harness
import numpy as np
import walks
from harness import Figure
from verdicts import GOOD, Case, judge_by_methods, list_cases, turn_gyr

from fg_nav.detection.mount import measure_axes
from fg_nav.errors import FgNavError
from fg_nav.estimators import estimate
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import RawRecording, Recording
from fg_nav.solution import Solution
from fg_nav.verdict import UNUSABLE, judge_path
from fg_nav.walk import Options, Walk

REFUSED = "refused"
WORDS = ("trusted", "doubtful", UNUSABLE, REFUSED)
MIN_S, MAX_S = 4.0, 40.0
MAX_M_S, STRIDES_M_S = 18.0, 10.0
MIN_STRIDES = 3
ASKED_SHARE = 0.95

Change = Callable[[RawRecording], RawRecording]


def _flip(axis: int) -> np.ndarray:
    return np.diag([-1.0 if i == axis else 1.0 for i in range(3)])


def _turn_both(raw: RawRecording, change: np.ndarray) -> RawRecording:
    return replace(turn_gyr(raw, change), acc=raw.acc @ change.T)


def _turn_acc(raw: RawRecording, change: np.ndarray) -> RawRecording:
    return replace(raw, acc=raw.acc @ change.T)


def _scale(raw: RawRecording, acc: float = 1.0, gyr: float = 1.0) -> RawRecording:
    return replace(raw, acc=acc * raw.acc, gyr=gyr * raw.gyr)


OWN = "as it was"
AXES: Mapping[str, Change] = {
    "gyroscope negated": partial(turn_gyr, change=-np.eye(3)),
    **{f"gyr {name} negated": partial(turn_gyr, change=_flip(i)) for i, name in enumerate("xyz")},
    **{f"acc {name} negated": partial(_turn_acc, change=_flip(i)) for i, name in enumerate("xyz")},
    **{f"{name} of both negated": partial(_turn_both, change=_flip(i)) for i, name in enumerate("xyz")},
    "gyr x and y exchanged": partial(turn_gyr, change=np.eye(3)[[1, 0, 2]]),
}
SCALES: Mapping[str, Change] = {
    "acc in g": partial(_scale, acc=1 / 9.80665),
    "acc 10 % too small": partial(_scale, acc=0.9),
    "acc 10 % too large": partial(_scale, acc=1.1),
    "gyr in deg/s": partial(_scale, gyr=180 / np.pi),
    "gyr 10 % too small": partial(_scale, gyr=0.9),
}


@dataclass(frozen=True)
class Piece:
    """A part of a walk, spoiled in one way."""

    case: Case
    place: float
    length_s: float
    kind: str

    def load(self) -> RawRecording:
        """Cut it out and spoil it."""
        whole = Recording.from_raw(self.case.load())
        first = whole.t[0] + self.place * max(whole.duration_s - self.length_s, 0.0)
        part = np.flatnonzero((whole.t >= first) & (whole.t < first + self.length_s))
        cut = RawRecording(whole.t[part], whole.acc[part], whole.gyr[part], part)
        change = {**AXES, **SCALES}.get(self.kind)
        return cut if change is None else change(cut)


@dataclass(frozen=True)
class Judged:
    """A piece by one method: the word, the reasons, and whether its path is absurd."""

    piece: str
    kind: str
    word: str
    reasons: tuple[str, ...]
    strides: int
    absurd: bool
    for_axes: bool

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        return {**self.__dict__, "reasons": list(self.reasons)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Judge all pieces, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__, arguments, data=None, seed=1, repeats=4, methods=["iez"], per_walk=False, jobs=1, json=None
    )
    pieces = draw_pieces(list_cases(walks.data_folder(chosen.data)), chosen.seed, chosen.repeats)
    judge_by_methods(judge_piece, pieces, chosen.methods, chosen, print_counts, judge_counts)


def draw_pieces(cases: Sequence[Case], seed: int, repeats: int) -> list[Piece]:
    """Draw pieces of the good walks: `repeats` of each as it was, with wrong axes and with wrong scales."""
    rng = np.random.default_rng(seed)
    pieces = []
    for case in (one for one in cases if one.kind == GOOD):
        for kinds in ((OWN,), tuple(AXES), tuple(SCALES)):
            for kind in rng.choice(kinds, repeats):
                length = float(np.exp(rng.uniform(*np.log([MIN_S, MAX_S]))))
                pieces.append(Piece(case, float(rng.random()), length, str(kind)))
    return pieces


def judge_piece(piece: Piece, method: str) -> Judged:
    """Send a piece through the whole way of a recording."""
    raw = piece.load()
    name = f"{piece.case.name}, {piece.length_s:.1f} s at {100 * piece.place:.0f} %"
    strides = measure_axes(raw.t, raw.acc, raw.gyr).strides
    try:
        walk = prepare_walk(Walk.of(Recording.from_raw(raw), Options(mount="foot")))
        solution = estimate(walk, method)
        verdict = judge_path(walk, solution)
    except FgNavError as error:
        return Judged(name, piece.kind, REFUSED, (str(error),), strides, False, "gravity turns" in str(error))
    absurd = verdict.word != UNUSABLE and is_absurd(solution)
    return Judged(name, piece.kind, verdict.word, verdict.reasons, strides, absurd, False)


def is_absurd(solution: Solution) -> bool:
    """Whether a path has a speed or a stride that no person has."""
    speed = np.linalg.norm(solution.velocity, axis=1).max()
    strides = np.linalg.norm(np.diff(solution.stances.position, axis=0), axis=1) / np.diff(solution.stances.t)
    return bool(speed > MAX_M_S or strides.max(initial=0.0) > STRIDES_M_S)


def print_counts(method: str, judged: Sequence[Judged], per_walk: bool) -> None:
    """Print how many of each kind have which word, and those that pass with wrong axes or absurd paths."""
    harness.print_heading(f"Pieces of walks by {method}")
    counts = Counter((one.kind, one.word) for one in judged)
    kinds = [kind for kind in (OWN, *AXES, *SCALES) if any(one.kind == kind for one in judged)]
    harness.print_table(("pieces", *WORDS), [[kind, *(str(counts[kind, word]) for word in WORDS)] for kind in kinds])
    for one in judged:
        passes = one.kind in AXES and one.word in WORDS[:2]
        if per_walk or one.absurd or passes or (one.for_axes and one.kind == OWN):
            words = f"{one.kind}, {one.piece}, {one.strides} strides: {one.word}: {'; '.join(one.reasons)}"
            harness.console().print(words, soft_wrap=True)


def judge_counts(method: str, judged: Sequence[Judged]) -> list[Figure]:
    """Absurd paths without the words, own axes refused, and wrong axes that do not pass."""
    own = [one for one in judged if one.kind == OWN]
    wrong = [one for one in judged if one.kind in AXES]
    walked = [one for one in wrong if one.strides >= MIN_STRIDES]
    stopped = sum(one.word not in WORDS[:2] for one in walked)
    pattern = "{:.0f}"
    return [
        Figure("pieces", f"absurd, and taken, of {len(judged)}", method, sum(one.absurd for one in judged), 0, 0,
               pattern=pattern),
        Figure("pieces", f"own axes refused, of {len(own)}", method, sum(one.for_axes for one in own), 0, 0,
               pattern=pattern),
        Figure("pieces", f"wrong axes trusted, of {len(wrong)}", method,
               sum(one.word == WORDS[0] for one in wrong), pattern=pattern),
        Figure("pieces", f"wrong axes stopped, of {len(walked)} that walk", method, stopped,
               ASKED_SHARE * len(walked), pattern=pattern),
    ]  # fmt: skip


if __name__ == "__main__":
    harness.run(main)
