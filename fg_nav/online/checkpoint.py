"""Save a walk in progress and resume it, to the same answer.

A checkpoint is one .npz of arrays with a version: the samples, the ends of the footfalls, and as JSON the options, the
parameters of the detection, the source, and what was left out. To resume, the samples go through a new navigator: the
same samples give the same answer to the last bit. That takes some hundredths of the time of the walk; saving takes time
in proportion to the walk.

The write is atomic: a file next to it is written, synced to the disk and then renamed.

With a lag the samples are discarded, so there is no checkpoint.
"""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from fg_nav.arrays import Floats, Ints
from fg_nav.detection.causal import CausalParameters
from fg_nav.errors import EstimationError, FormatError, OutputError
from fg_nav.online.buffer import COLUMNS
from fg_nav.online.judge import SampleJudge
from fg_nav.online.options import OnlineOptions
from fg_nav.online.pocket import Navigator, PocketOptions, begin_walk
from fg_nav.recording import Fix
from fg_nav.smoother.parameters import FieldParameters, SmootherParameters
from fg_nav.text import to_json

VERSION = 4
"""Of the arrays in a checkpoint."""

BLOCK = 1 << 14
"""Rows that are replayed at once; the answer does not depend on it."""


def save(navigator: Navigator, path: Path | str) -> None:
    """Write a checkpoint in place of an older one.

    Raises
    ------
    EstimationError
        With a lag.
    OutputError
        If the file cannot be written.
    """
    write_content(collect_content(navigator), path)


def collect_content(navigator: Navigator) -> dict[str, Any]:
    """Return a copy of what a checkpoint holds, while the walk goes on; raises `EstimationError` with a lag."""
    if navigator.options.lag_s is not None:
        raise EstimationError("a walk with a lag discards its samples and has no checkpoint: leave one of the two out.")
    facts = {
        "options": to_json(navigator.options),
        "detection": to_json(navigator.detection),
        "judge": navigator.judge.state(),
        "source": dict(navigator.source),
        "has_ended": navigator.has_ended,
    }
    return {
        "version": np.array(VERSION),
        "samples": navigator.buffer.between(0, navigator.buffer.stop),
        "footfall_stop": _stops(navigator),
        "facts": np.array(json.dumps(facts)),
    }


def write_content(content: Mapping[str, Any], path: Path | str) -> None:
    """Write the content of a checkpoint in place of an older one; raises `OutputError` if that cannot be."""
    path = Path(path)
    try:
        _write_atomically(path, content)
    except OSError as error:
        reason = (error.strerror or type(error).__name__).lower()
        raise OutputError(f"{path} cannot be written ({reason}): name another checkpoint, or make room.") from None


def load(
    path: Path | str,
    options: OnlineOptions | PocketOptions | None = None,
    remark: Callable[[str], None] = lambda words: None,
    progress: Callable[[float], None] | None = None,
    detection: CausalParameters = CausalParameters(),
    beside: bool = False,
) -> Navigator:
    """Resume a walk where a checkpoint left it.

    Push what the source sends then, from its beginning or from a later moment on (`overlap`, `judge`). A walk that had
    ended when it was saved has ended now too: it takes no more samples, and can be asked for all else.

    Parameters
    ----------
    path
        Of the checkpoint.
    options
        Of the walk, for comparison; None for those of the checkpoint, with its gate and otherwise the usual parameters.
    remark
        As for `OnlineNavigator`.
    progress
        Given from time to time the fraction that is done.
    detection, beside
        As for `OnlineNavigator`.

    Raises
    ------
    FormatError
        If the file is no checkpoint, or one of another version.
    EstimationError
        If it was made with other options or another detection, or finds other footfalls now.
    """
    path = Path(path)
    samples, stops, facts = _read(path)
    options = _read_options(facts["options"]) if options is None else options
    for given, name, other in ((options, "options", "other options"), (detection, "detection", "another detection")):
        if to_json(given) != facts[name]:
            raise EstimationError(f"{path.name} was made with {other}: give the same, or name another checkpoint.")
    judge = SampleJudge.resume(facts["judge"], samples, remark)
    navigator = begin_walk(options, remark, detection, judge, beside)
    navigator.source.update(facts["source"])
    for start in range(0, len(samples), BLOCK):
        navigator.add_rows(samples[start : start + BLOCK])
        if progress is not None:
            progress(min(start + BLOCK, len(samples)) / len(samples))
    if facts["has_ended"]:
        navigator.close()
    if not np.array_equal(_stops(navigator), stops):
        raise EstimationError(f"{path.name} is of a version that found other footfalls: begin the walk again.")
    return navigator


def _stops(navigator: Navigator) -> Ints:
    return np.array([int(footfall.stop[-1]) for footfall in navigator.footfalls], dtype=np.int64)


def _read_options(words: Mapping[str, Any]) -> OnlineOptions | PocketOptions:
    if "step_constant_m" in words:
        return PocketOptions(**words)
    parameters = SmootherParameters(magnetic=FieldParameters(gate=words["parameters"]["magnetic"]["gate"]))
    fixes = tuple(_read_fix(**fix) for fix in words["fixes"])
    given = (words["heading_rad"], bool(words["use_field"]), words["lag_s"], parameters, words["axes_given"], fixes)
    return OnlineOptions(*given)


def _read_fix(time_s: float, position: list[float], horizontal_sigma_m: float, vertical_sigma_m: float | None) -> Fix:
    """Return a fix of its JSON values, in which an infinite sigma is None."""
    return Fix(time_s, np.array(position), horizontal_sigma_m, np.inf if vertical_sigma_m is None else vertical_sigma_m)


def _write_atomically(path: Path, content: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(prefix=f".{path.name}-", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)  # the new name too
    finally:
        os.close(folder)


def _read(path: Path) -> tuple[Floats, Ints, dict[str, Any]]:
    refusal = FormatError(f"{path.name} is no checkpoint of a walk: name another file, or remove it.")
    try:
        with np.load(path, allow_pickle=False) as content:
            version = int(content["version"])
            if version != VERSION:
                raise FormatError(
                    f"{path.name} is a checkpoint of version {version} and this program reads {VERSION}: begin again."
                )
            samples, stops = content["samples"], content["footfall_stop"]
            facts = json.loads(str(content["facts"]))
    except (ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile):
        raise refusal from None
    if samples.ndim != 2 or samples.shape[1] != COLUMNS or samples.dtype != np.float64:
        raise refusal
    return samples, stops, facts
