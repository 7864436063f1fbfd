"""How often the lines of a good walk in progress say that they are not to be used, or doubtful, without a cause.

    python scripts/line_verdicts.py [--data DIR] [--kinds KIND ...] [--every NTH] [--per-walk] [--jobs N]
                                    [--json FILE]

The recordings of `verdict_recordings.py`, the good ones if nothing else is asked for, go as rows through
`follow_source`, without a magnetometer; each line has its verdict. Lines that are doubtful because little was walked
are as they should be, and counted apart. Asked of good walks: none refused, none with a line that is not to be used,
one in twenty at most with a line that is doubtful for another reason.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import harness
import numpy as np
import walks
from harness import Figure, option
from verdict_recordings import GOOD, Case, judge_by_methods, list_cases

from fg_nav.arrays import Floats
from fg_nav.errors import FgNavError
from fg_nav.online.buffer import COLUMNS
from fg_nav.online.follow import StreamOptions, follow_source
from fg_nav.online.options import OnlineOptions
from fg_nav.recording import RawRecording
from fg_nav.verdict import UNUSABLE

BLOCK = 256
TRUSTED, DOUBTFUL, REFUSED = "trusted", "doubtful", "refused"
BEGINNING = "too little has been walked to know"
WORDS = (TRUSTED, BEGINNING, DOUBTFUL, UNUSABLE, REFUSED)
ASKED_DOUBTFUL = 1 / 20


class RawRows:
    """A `SampleSource` of the rows of a recording as they stand in its file, or of its first `share`."""

    name, header, lost = "a recording", None, 0

    def __init__(self, raw: RawRecording, share: float = 1.0) -> None:
        rows = np.column_stack([raw.t, raw.acc, raw.gyr, np.full((len(raw.t), 3), np.nan)])
        self._rows, self._given = rows[: round(share * len(rows))], 0

    def resume(self, header: Sequence[str]) -> None:
        """See `SampleSource`."""

    def read(self, wait_s: float) -> Floats | None:
        """See `SampleSource`."""
        first, self._given = self._given, self._given + BLOCK
        return self._rows[first : self._given] if first < len(self._rows) else None

    def finish(self) -> Floats:
        """See `SampleSource`."""
        return np.empty((0, COLUMNS))

    def close(self) -> None:
        """Nothing is open."""


@dataclass(frozen=True)
class Judged:
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


def judge_lines(case: Case, method: str) -> Judged:
    """Follow a recording, and count the verdicts of its lines; there is one method."""
    lines: list[str] = []
    options = StreamOptions(online=OnlineOptions(use_field=False))
    try:
        follow_source(RawRows(case.load()), options, lines.append, lambda words: None)
    except FgNavError as error:
        return Judged(case.kind, case.name, Counter({REFUSED: 1}), Counter({str(error): 1}))
    told = [one for one in map(json.loads, lines) if one["kind"] == "now"]
    words, reasons = Counter[str](), Counter[str]()
    for one in told:
        why = [reason for reason in map(name_reason, one["reasons"]) if reason != BEGINNING]
        has_begun = one["verdict"] != DOUBTFUL or bool(why)
        words[one["verdict"] if has_begun else BEGINNING] += 1
        reasons.update(why if one["verdict"] != TRUSTED else ())
    return Judged(case.kind, case.name, words, reasons)


def name_reason(words: str) -> str:
    """A reason without its figures, so that those of several lines are one."""
    return BEGINNING if words.startswith(BEGINNING) else re.sub(r"[-+]?[0-9][0-9.]*", "#", words)


def print_counts(method: str, judged: Sequence[Judged], per_walk: bool) -> None:
    """Print how many walks of each kind have a line of each word, and why; and the walks that are not as asked."""
    harness.print_heading(f"Lines of walks by {method}: recordings with one of the word, and lines in all")
    rows = []
    for kind in dict.fromkeys(one.kind for one in judged):
        of_kind = [one for one in judged if one.kind == kind]
        having = [
            f"{sum(one.has(word) for one in of_kind)} ({sum(one.words[word] for one in of_kind)})" for word in WORDS
        ]
        rows.append([kind, str(len(of_kind)), *having])
    harness.print_table(("kind", "recordings", *WORDS), rows)
    for one in judged:
        if per_walk or (one.kind == GOOD and any(one.has(word) for word in (DOUBTFUL, UNUSABLE, REFUSED))):
            why = "; ".join(f"{number} times: {reason}" for reason, number in one.reasons.most_common())
            harness.console().print(f"{one.kind}, {one.name}: {dict(one.words)}: {why}", soft_wrap=True)


def judge_counts(method: str, judged: Sequence[Judged]) -> list[Figure]:
    """Good walks that are refused, or have a line against them."""
    good = [one for one in judged if one.kind == GOOD]
    asked = {REFUSED: 0.0, UNUSABLE: 0.0, DOUBTFUL: ASKED_DOUBTFUL * len(good)}
    return [
        Figure("lines", f"good walks {word}, of {len(good)}", method, sum(one.has(word) for one in good), high=most,
               pattern="{:.0f}")
        for word, most in asked.items()
    ]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Judge all recordings, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        data=None,
        kinds=option([GOOD], "of recordings", nargs="+", metavar="KIND"),
        every=option(1, "recording is looked at", metavar="NTH"),
        per_walk=False,
        jobs=1,
        json=None,
    )
    cases = [one for one in list_cases(walks.data_folder(chosen.data)) if one.kind in chosen.kinds][:: chosen.every]
    judge_by_methods(judge_lines, cases, ("stream",), chosen, print_counts, judge_counts)


if __name__ == "__main__":
    harness.run(main)
