"""Verdicts on recordings that are good walks, and on such as are no walk or were spoiled (`verdict_recordings.py`).

    python scripts/verdicts.py [--data DIR] [--methods NAME ...] [--per-walk] [--jobs N] [--json FILE]

Asked: of 40 that are no walk or spoiled 38 or more not "trusted", of 60 good walks 58 or more "trusted". A recording
that is refused is not trusted. Nothing is set by recording, and no limit by these: they are those of walking and of
sensors (`fg_nav.verdict`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import harness
import walks
from harness import Figure
from verdict_recordings import GOOD, Case, judge_by_methods, list_cases

from fg_nav.errors import FgNavError
from fg_nav.estimators import estimate
from fg_nav.pipeline import prepare_walk
from fg_nav.recording import Recording
from fg_nav.verdict import judge_path
from fg_nav.walk import Options, Walk

TRUSTED, REFUSED = "trusted", "refused"
WORDS = (TRUSTED, "doubtful", "not to be used", REFUSED)
ASKED_GOOD, ASKED_SPOILED = 58 / 60, 38 / 40


@dataclass(frozen=True)
class Judged:
    """A recording by one method: the word, and the reasons."""

    kind: str
    name: str
    method: str
    word: str
    reasons: tuple[str, ...]

    def as_dict(self) -> dict[str, object]:
        """Ready for JSON."""
        return {**self.__dict__, "reasons": list(self.reasons)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Judge all recordings, print, and write what was asked for."""
    chosen = harness.parse_arguments(
        __doc__, arguments, data=None, methods=["smoother"], per_walk=False, jobs=1, json=None
    )
    cases = list_cases(walks.data_folder(chosen.data))
    judge_by_methods(judge_case, cases, chosen.methods, chosen, print_counts, judge_counts)


def judge_case(case: Case, method: str) -> Judged:
    """Estimate a recording by a method, and judge the path."""
    try:
        walk = prepare_walk(Walk.of(Recording.from_raw(case.load()), Options(mount="foot")))
        verdict = judge_path(walk, estimate(walk, method))
    except FgNavError as error:
        return Judged(case.kind, case.name, method, REFUSED, (str(error),))
    return Judged(case.kind, case.name, method, verdict.word, verdict.reasons)


def print_counts(method: str, judged: Sequence[Judged], per_walk: bool) -> None:
    """Print how many of each kind have which word, and those that are not as they should be."""
    harness.print_heading(f"Verdicts on the paths of {method}")
    kinds = list(dict.fromkeys(one.kind for one in judged))
    counts = Counter((one.kind, one.word) for one in judged)
    rows = [[kind, *(str(counts[kind, word]) for word in WORDS)] for kind in kinds]
    harness.print_table(("recordings", *WORDS), rows)
    for one in judged:
        if per_walk or (one.word == TRUSTED) != (one.kind == GOOD):
            harness.console().print(f"{one.kind}, {one.name}: {one.word}: {'; '.join(one.reasons)}", soft_wrap=True)


def judge_counts(method: str, judged: Sequence[Judged]) -> list[Figure]:
    """Shares of the good ones that are trusted, and of the others that are not."""
    good = [one.word == TRUSTED for one in judged if one.kind == GOOD]
    other = [one.word != TRUSTED for one in judged if one.kind != GOOD]
    names = f"good walks trusted, of {len(good)}", f"others not trusted, of {len(other)}"
    asked = ASKED_GOOD * len(good), ASKED_SPOILED * len(other)
    return [
        Figure("verdicts", name, method, sum(some), low, pattern="{:.0f}")
        for name, some, low in zip(names, (good, other), asked, strict=True)
    ]


if __name__ == "__main__":
    harness.run(main)
