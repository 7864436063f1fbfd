"""Methods on simulated walks for a paper: what is kept in the folder is taken up, the rest is made.

The folder is that of `fg_nav.lab.campaign.kept`, so that results of a campaign with the same walks hold here too. Parts
(`fg_nav.lab.reproduce.parts`) are made beside the walks, by the same workers.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from fg_nav.errors import OutputError
from fg_nav.lab.campaign import kept
from fg_nav.lab.campaign.kept import Key, Result, without_paths
from fg_nav.lab.campaign.made import jobs_of, made
from fg_nav.lab.campaign.pool import as_done
from fg_nav.lab.campaign.settings import settings_of
from fg_nav.lab.campaign.sources import LOOP
from fg_nav.lab.reproduce.parts import Part
from fg_nav.wording import counted

FOLDER = "cells"
"""Of the folder of a reproduction."""

Task = Callable[[], None]
"""Something that one worker makes and keeps."""


@dataclass(frozen=True)
class Walks:
    """Results by (scenario, field, method), each in the order of the seeds."""

    results: dict[tuple[str, str, str], list[Result]] = field(default_factory=dict)

    def of(self, scenario: str, level: str, method: str) -> list[Result]:
        """Results of one method; none where it was not asked for."""
        return self.results.get((scenario, level, method), [])


def keys_of(scenario: str, levels: Sequence[str], methods: Sequence[str], seeds: Sequence[int]) -> list[Key]:
    """Every method on every walk, the iron on the shoe known from a calibration loop, as Ma did it."""
    return [Key(scenario, level, str(seed), LOOP, method) for level in levels for method in methods for seed in seeds]


def make_missing(
    folder: Path,
    keys: Sequence[Key],
    parts: Sequence[Part],
    workers: int = 1,
    progress: Callable[[float], None] | None = None,
) -> None:
    """Make what is not kept in the folder; the progress is the share of the tasks done.

    Raises
    ------
    OutputError
        Where a folder or a file cannot be written.
    """
    tasks = [*_walks_to_make(folder, keys), *_parts_to_make(folder, parts)]
    for done, _ in enumerate(as_done(tasks, workers), start=1):
        if progress is not None:
            progress(done / len(tasks))


def _walks_to_make(folder: Path, keys: Sequence[Key]) -> list[Task]:
    cells = folder / FOLDER
    try:
        cells.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{cells} could not be made ({error.strerror}): name another folder.") from error
    settings = {key: settings_of(key) for key in keys}
    missing = [key for key in keys if kept.kept(cells, key, settings[key]) is None]
    return [partial(made, job, cells, kept.code_sum()) for job in jobs_of(missing, settings)]


def _parts_to_make(folder: Path, parts: Sequence[Part]) -> list[Task]:
    return [partial(part.make_into, folder) for part in parts if part.read(folder) is None]


def read_walks(folder: Path, keys: Sequence[Key]) -> Walks:
    """Read results, all of which are there; only the first of a method that did not fail keeps its path."""
    found = Walks()
    for key in keys:
        result = kept.kept(folder / FOLDER, key, settings_of(key))
        assert result is not None, f"{key.file} was not made"
        before = found.results.setdefault((key.group, key.field, key.method), [])
        before.append(without_paths(result) if any(one.estimate for one in before) else result)
    return found


def made_by(walks: Walks) -> dict[str, int]:
    """How many results each state of code and libraries made, by its sum (`fg_nav.lab.campaign.kept.code_sum`)."""
    return dict(Counter(one.code for results in walks.results.values() for one in results))


def made_elsewhere(walks: Walks) -> tuple[str, ...]:
    """One sentence where other code than this made some of the results, for what differs; none where this made all."""
    by_sum = made_by(walks)
    total, others = sum(by_sum.values()), {code: n for code, n in by_sum.items() if code != kept.code_sum()}
    if not others:
        return ()
    most_first = sorted(others.items(), key=lambda one: (-one[1], one[0]))
    sums = (
        f"sum {most_first[0][0]}" if len(others) == 1 else ", ".join(f"{n} with sum {code}" for code, n in most_first)
    )
    return (
        f"{sum(others.values())} of {counted(total, 'result')} on walks were made by another state of the code, or of "
        f"its libraries, than this one ({sums}), with the same parameters: "
        f"without the folder '{FOLDER}' all are made anew.",
    )


def parameters_of(walks: Walks) -> dict[str, Any]:
    """Effective parameters of each method, as it told them on its first walk."""
    found: dict[str, Any] = {}
    for (_, _, method), results in walks.results.items():
        found.setdefault(method, next((result.parameters for result in results if not result.failed), {}))
    return found
