"""The files of a result (docs/files.md; of two feet docs/two_feet.md): writing, summary, configuration.

`save_solution` and `plot_solution` are `Solution.save` and `Solution.plot`. Of a sensor on each foot a missing foot has
no files, and its part of the summary is null. Stamps are those of the first recording's clock.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeGuard

import numpy as np
import pandas as pd

from fg_nav.errors import OutputError
from fg_nav.estimators import get_method
from fg_nav.evaluation.metrics import Metrics, evaluate, measure_gap
from fg_nav.gait import summarize_gait
from fg_nav.io import write_tum
from fg_nav.magnetic.axes import MagAxes
from fg_nav.magnetic.detectors import NO_GATE, QUASI_STATIC, UNKNOWN, find_gate
from fg_nav.pipeline import Result
from fg_nav.report import Plots
from fg_nav.report.folder import result_folder
from fg_nav.solution import Solution, StanceTable
from fg_nav.text import find_version, to_json
from fg_nav.truth import FIX_SPEED_M_S
from fg_nav.verdict import Verdict, judge_footfalls, judge_path
from fg_nav.walk import Outcome, Walk, find_origin

if TYPE_CHECKING:
    from fg_nav.both_feet import FeetResult
    from fg_nav.report.charts import Paths

Summary: TypeAlias = dict[str, object]  # Figures of merit, ready for JSON; None where unknown.

_STRUCTURED = ("magnetometer_delay", "located")  # Of the summary, no figures, nor are lists and dictionaries.

TRUTH_KEYS = ("rmse_2d_m", "rmse_3d_m", "end_error_m", "max_error_m", "heading_rmse_deg", "alignment")
_MORE_TRUTH_KEYS = ("scale", "points", "strides_true")
POLISHED_KEYS = ("distance_m", "closure_m", "closure_percent", "rmse_2d_m", "rmse_3d_m", "end_error_m", "max_error_m",
    "heading_rmse_deg")  # fmt: skip
"""Of the batch solution next to an online one, each as `polished_` and its name, the errors with a truth only."""
FOOT_KEYS = (
    "distance_m", "distance_sigma_m", "strides", "closure_m", "closure_percent", "end_m", "end_sigma_m", "graph",
    *TRUTH_KEYS, "scale", "verdict", "reasons", "returns", "magnetometer", "magnetometer_delay", "notes",
)  # fmt: skip
"""Of each of two feet; the other keys are the same as the person's."""

_GIVEN = (
    "preset", "gate", "magnetic", "use_magnetometer", "mag_axes", "calibration_path", "places_path", "alignment",
    "polish", "step_constant_m", "heading_deg", "known_distance_m", "fixes_path", "gnss_path", "truth_path",
)  # fmt: skip
"""Options of a walk that a configuration repeats."""

# Options of the command line, and the arguments in their place.
_OPTIONS = {"--out": "path", "--force": "force=True", "--origin 48.137,11.575": "origin=(48.137, 11.575)"}


# --- writing ---------------------------------------------------------------------------------------------------------


def write_run(
    folder: Path, walk: Walk, outcome: Outcome, plots: Plots = "html", summary: Summary | None = None
) -> Summary:
    """Write the result of one method into an existing folder, with page and pictures; return the summary."""
    summary = summarize(walk, outcome) if summary is None else summary
    name, config = outcome.solution.method, describe_run(walk, outcome.solution)
    _write_files(folder, outcome.solution, summary, config)
    if walk.options.mount != "pocket":
        write_gait(folder, outcome.solution)
    _write_drawings(folder, {name: outcome}, [summary], {name: config}, {name: walk}, plots)
    return summary


def write_comparison(folder: Path, walk: Walk, outcomes: Mapping[str, Outcome], plots: Plots = "html") -> list[Summary]:
    """Write each method's files into its own folder, `comparison.csv` and `.json`, page and pictures."""
    summaries = [summarize(walk, outcome) for outcome in outcomes.values()]
    configs = {name: describe_run(walk, outcome.solution) for name, outcome in outcomes.items()}
    for (name, outcome), summary in zip(outcomes.items(), summaries, strict=True):
        (folder / name).mkdir()
        _write_files(folder / name, outcome.solution, summary, configs[name])
        write_gait(folder / name, outcome.solution)
    rows = [
        {key: value for key, value in row.items() if not isinstance(value, list | dict) and key not in _STRUCTURED}
        for row in summaries
    ]
    pd.DataFrame(rows).to_csv(folder / "comparison.csv", index=False, float_format="%.9g")
    write_json(folder / "comparison.json", summaries)
    _write_drawings(folder, outcomes, summaries, configs, dict.fromkeys(outcomes, walk), plots)
    return summaries


def write_lagged(folder: Path, solution: Solution, plots: Plots = "html") -> Summary:
    """Write the result of a walk in progress whose samples were not kept; return the summary."""
    name, summary = solution.method, summarize_lagged(solution)
    _write_files(folder, solution, summary)
    config: dict[str, object] = {"method": name, "parameters": solution.parameters}
    _write_drawings(folder, {name: Outcome(solution, evaluate(solution), None)}, [summary], {name: config}, {}, plots)
    return summary


def write_feet(folder: Path, result: FeetResult, plots: Plots = "html") -> Summary:
    """Write the result of both feet, the person's and each one's, with page and pictures; return the summary."""
    summary, pairing = summarize_feet(result), result.pairing
    feet = {str(side): foot for side, foot in result.feet.items()}
    configs = {side: describe_run(foot.walk, foot) for side, foot in feet.items()}
    request: dict[str, object] = {
        "fg_nav_version": find_version(),
        "method": result.method,
        "mount": "feet",
        "sides": list(pairing.order),
        "sides_known": pairing.sides,
        "clock_offset_s": pairing.clock_offset_s,
        "heading_deg": pairing.heading_deg,
        "parameters": describe_given(next(iter(feet.values())).walk, result.method)["parameters"],
    }
    for side, foot in feet.items():
        write_paths(folder, foot, f"_{side}")
    _write_files(folder, result, summary, request | configs, "person")
    write_gait(folder, result)
    outcomes = {side: foot.outcome for side, foot in feet.items()}
    walks = {side: foot.walk for side, foot in feet.items()}
    _write_drawings(folder, outcomes, [summary], configs, walks, plots, result)
    return summary


def _write_drawings(
    folder: Path,
    outcomes: Mapping[str, Outcome],
    summaries: Sequence[Summary],
    configs: Mapping[str, Mapping[str, object]],
    walks: Mapping[str, Walk],
    plots: Plots,
    both: FeetResult | None = None,
) -> None:
    """Write the page of one or more methods, or of both feet, and the pictures where the samples are there."""
    if plots in ("html", "all"):
        from fg_nav.report.page import compose_page, write_page

        write_page(folder, compose_page(outcomes, summaries, configs, walks, both))
    if plots in ("png", "all") and walks:
        from fg_nav.report.plots.style import draw_walk

        draw_walk(folder, next(iter(walks.values())), outcomes, both)


def _write_files(
    folder: Path,
    solution: Solution,
    summary: Summary,
    config: Mapping[str, object] | None = None,
    table: str = "strides",
) -> None:
    write_paths(folder, solution, table=table)
    if config is not None:
        write_json(folder / "config.json", config)
    write_json(folder / "summary.json", summary)


def write_footfalls(folder: Path, solution: Solution, summary: Summary) -> None:
    """Write the smallest useful result: footfalls and summary, some hundred bytes a stride."""
    write_strides(folder / "strides.csv", solution.stances)
    write_json(folder / "summary.json", summary)


def write_paths(folder: Path, solution: Solution, suffix: str = "", table: str = "strides") -> None:
    """Write trajectory and stances; of an online method also those of the moment, and of its batch solution."""
    write_tum(folder / f"trajectory{suffix}.tum", solution.t, solution.position, solution.nav_R_body)
    write_strides(folder / f"{table}{suffix}.csv", solution.stances)
    if solution.moment is not None:
        write_strides(folder / f"online{suffix}.csv", solution.moment)
    if solution.polished is not None:
        polished = solution.polished
        write_tum(folder / f"trajectory_polished{suffix}.tum", polished.t, polished.position, polished.nav_R_body)
        write_strides(folder / f"strides_polished{suffix}.csv", polished.stances)


def write_strides(path: Path, table: StanceTable) -> None:
    """Write one row a footfall."""
    _write_rows(path, table.to_dataframe(), ("time_s",))


def write_gait(folder: Path, solution: Solution) -> None:
    """Write one row a stride of a foot, or of both."""
    _write_rows(folder / "gait.csv", solution.to_dataframe("strides"), ("start_s", "end_s", "toe_off_s", "contact_s"))


def _write_rows(path: Path, table: pd.DataFrame, stamps: Sequence[str]) -> None:
    for name in stamps:  # nine significant digits would blur a clock's stamps
        table[name] = table[name].map("{:.9f}".format, na_action="ignore")
    table.to_csv(path, index=False, float_format="%.9g")


def write_json(path: Path, content: object) -> None:
    """Write standard JSON: numbers that are not finite become null."""
    path.write_text(json.dumps(to_json(content), indent=2, allow_nan=False) + "\n", encoding="utf-8")


# --- a single solution -----------------------------------------------------------------------------------------------


def save_solution(solution: Solution, path: Path, force: bool = False, origin: Sequence[Any] | None = None) -> Path:
    """Write a solution into a folder, or into a file of the format of its ending; return the path.

    `origin` is the start of the walk on the Earth, for maps: latitude, longitude, and height where it is known.

    Raises `OutputError` if something is there already, it cannot be written, or the ending is unknown.
    """
    try:
        if path.suffix:
            from fg_nav.report.export import export_track
            from fg_nav.report.export.track import ExportTrack, Origin

            track = ExportTrack.of(solution, path.stem)
            origin = origin or (find_origin(solution.walk.fixes, solution) if isinstance(solution, Result) else None)
            export_track(track, path, None if origin is None else Origin(*origin), force)
            return path
        with result_folder(path, force) as folder:
            if isinstance(solution, Result):
                summary = summarize(solution.walk, solution.outcome, solution.verdict)
                write_run(folder, solution.walk, solution.outcome, summary=summary)
            elif is_of_feet(solution):
                write_feet(folder, solution)
            else:
                write_lagged(folder, solution)
    except OutputError as error:
        words = str(error)
        for option, argument in _OPTIONS.items():
            words = words.replace(option, argument)
        raise OutputError(words) from None
    return path


def plot_solution(solution: Solution, axes: Any = None) -> Any:
    """Draw a solution from above, with its truth where it has one; return the axes."""
    from fg_nav.report.plots.style import draw_on_screen

    return draw_on_screen(align_any(solution), axes)


def align_any(solution: Solution) -> Paths:
    """Return the paths of a picture of a solution, aligned with its truth where it has one."""
    from fg_nav.report.charts import align_feet, align_paths

    if isinstance(solution, Result):
        return align_paths({solution.method: solution.outcome}, solution.walk)
    if is_of_feet(solution):
        return align_feet(solution)
    return align_paths({solution.method: Outcome(solution, evaluate(solution), None)}, None)


def is_of_feet(solution: Solution) -> TypeGuard[FeetResult]:
    """Whether a solution is that of a person with a sensor on each foot."""
    from fg_nav.both_feet import FeetResult

    return isinstance(solution, FeetResult)


# --- summaries -------------------------------------------------------------------------------------------------------


def summarize(walk: Walk, outcome: Outcome, verdict: Verdict | None = None) -> Summary:
    """Figures of merit of one method on a walk; its path is judged, unless the verdict is given."""
    solution, metrics = outcome.solution, outcome.metrics
    figures = _describe_path(solution, metrics, walk.recording.duration_s)
    if solution.distance_sigma_m is not None:
        figures["distance_sigma_m"] = solution.distance_sigma_m
    if solution.graph:
        figures["graph"] = dict(solution.graph)
    if outcome.comparison is not None:
        figures |= {key: getattr(metrics, key) for key in (*TRUTH_KEYS, *_MORE_TRUTH_KEYS)}
    if outcome.moment is not None:
        figures["moment_rmse_2d_m"] = outcome.moment.rmse_m
        figures["moment_end_error_m"] = outcome.moment.end_m
        figures["moment_max_error_m"] = outcome.moment.max_m
    if outcome.polished is not None:
        known = {f"polished_{key}": getattr(outcome.polished.metrics, key) for key in POLISHED_KEYS}
        figures |= {key: value for key, value in known.items() if value is not None}
        gap = measure_gap(solution, outcome.polished.solution)
        figures["polish_gap_rms_m"], figures["polish_gap_max_m"] = gap.rms_m, gap.max_m
        figures["polish_gap_heading_deg"] = gap.heading_deg
    verdict = judge_path(walk, solution) if verdict is None else verdict
    figures |= {"verdict": verdict.word, "reasons": list(verdict.reasons)}
    if walk.options.mount != "pocket":
        figures["gait"] = summarize_gait(solution.to_dataframe("strides"))[""]
    if solution.returns:
        figures["returns"] = [one.describe() for one in solution.returns]
    if walk.places is not None:
        figures["located"] = None if solution.located is None else solution.located.describe()
    if walk.fixes:
        figures["fixes"] = measure_fixes(walk, solution)
    if (origin := find_origin(walk.fixes, solution)) is not None:
        figures["origin"] = list(origin)
    field = "not used (none given)"
    if outcome.field_used:
        field = "used"
    elif walk.magnetometer is not None and walk.magnetometer.wrong_axes is not None:
        field = "not used (its axes are not the gyroscope's)"
    elif walk.recording.mag is not None or not walk.options.use_magnetometer:
        field = "not used"
    figures["magnetometer"] = field
    # delay, and whether it was corrected; None if it could not be observed
    delay = None if walk.magnetometer is None else walk.magnetometer.delay
    figures["magnetometer_delay"] = None if delay is None else {**asdict(delay), "taken_off": delay.taken_off}
    return figures | {"notes": [*collect_remarks(walk), *solution.notes, *metrics.notes]}


def measure_fixes(walk: Walk, solution: Solution) -> dict[str, float]:
    """Return the number of fixes, their distance over ground from where the foot stood, and those beyond 3 sigma."""
    time, standing = np.array([fix.time_s for fix in walk.fixes]), np.flatnonzero(walk.stances.mask)
    after = np.searchsorted(solution.t[standing], time)
    # of the samples before and after at which it stood, the nearer one
    samples = standing[np.clip([after - 1, after], 0, len(standing) - 1)]
    off = solution.position[samples] - [fix.position for fix in walk.fixes]
    nearer = (off[..., :2] ** 2).sum(axis=2).argmin(axis=0), np.arange(len(time))
    sigma = np.array([[fix.horizontal_sigma_m] * 2 + [fix.vertical_sigma_m] for fix in walk.fixes])
    sigma[:, :2] = np.hypot(sigma[:, :2], FIX_SPEED_M_S * np.abs(time - solution.t[samples[nearer]])[:, None])
    off, rms = off[nearer], float(np.sqrt(2.0 * (off[nearer][:, :2] ** 2).mean()))
    return {"count": len(time), "rms_m": rms, "beyond_3_sigma": int((np.abs(off) > 3.0 * sigma).any(axis=1).sum())}


def summarize_lagged(solution: Solution) -> Summary:
    """Figures of merit that need no samples."""
    verdict = judge_footfalls(solution.stances)
    judged: Summary = {"method": solution.method, "verdict": verdict.word, "reasons": list(verdict.reasons)}
    figures = _describe_path(solution, evaluate(solution), float(solution.t[-1] - solution.t[0]))
    return judged | figures | {"notes": list(solution.notes)}


def summarize_feet(result: FeetResult) -> Summary:
    """Figures of merit of the person, the coupling of the feet, and the figures of each foot; None of a missing one."""
    metrics, pairing, verdict = result.metrics, result.pairing, result.verdict
    figures: Summary = {
        "method": result.method,
        "mount": "feet",
        **_describe_path(result, metrics, float(result.t[-1] - result.t[0])),
        "width_m": pairing.width_m,
        "width_sigma_m": pairing.width_sigma_m,
        "cells": pairing.cells,
        "beyond_reach": pairing.beyond_reach,
        "sides": list(pairing.order),
        "sides_known": pairing.sides,
        "clock_offset_s": pairing.clock_offset_s,
        "clock_drift": pairing.clock_drift,
        "clock_offset_known": "given" if pairing.clock_given else "by the signals" if pairing.cells else None,
    }
    if result.outcome.comparison is not None:
        figures |= {key: getattr(metrics, key) for key in (*TRUTH_KEYS, "scale", "points")}
    figures |= {"verdict": verdict.word, "reasons": list(verdict.reasons), "left": None, "right": None}
    fields = dict[str, str]()
    for side, foot in result.feet.items():
        whole, path = summarize(foot.walk, foot.outcome, foot.verdict), foot.walk.recording.provenance.path
        known = {key: whole[key] for key in FOOT_KEYS if key in whole}
        figures[side], fields[side] = {"recording": _text(path), **known}, str(whole["magnetometer"])
    # the field in words of both feet, or of each where they differ
    words = set(fields.values())
    figures["magnetometer"] = ", ".join(words if len(words) == 1 else map(" ".join, fields.items()))
    figures["gait"] = summarize_gait(result.to_dataframe("strides"))
    return figures | {"notes": [*result.notes, *metrics.notes]}


def _describe_path(solution: Solution, metrics: Metrics, duration_s: float) -> Summary:
    """Figures that need no truth; the position of the last footfall from the first and its sigmas are x, y, z m."""
    table = solution.stances
    return {
        "method": solution.method,
        "duration_s": duration_s,
        "distance_m": metrics.distance_m,
        "strides": metrics.strides_detected,
        "closure_m": metrics.closure_m,
        "closure_percent": metrics.closure_percent,
        "runtime_s": solution.runtime_s,
        "realtime_factor": duration_s / solution.runtime_s if solution.runtime_s > 0 else None,
        "end_m": to_json(table.position[-1] - table.position[0]),
        "end_sigma_m": to_json(table.position_sigma[-1]),
    }


def collect_remarks(walk: Walk) -> list[str]:
    """Notes on the recording, its calibration and its field: independent of the method."""
    return [*walk.recording.provenance.notes, *walk.notes]


# --- configuration ---------------------------------------------------------------------------------------------------


def describe_run(walk: Walk, solution: Solution) -> dict[str, object]:
    """Return everything needed to repeat the run."""
    stances = walk.stances
    return {
        "fg_nav_version": find_version(),
        "method": solution.method,
        **describe_recording(walk),
        "alignment": walk.options.alignment,
        "detector": {
            "name": stances.detector,
            "threshold": stances.threshold,
            "stances": len(stances),
            "footfalls": stances.n_footfalls,
            **({} if walk.detection is None else {"parameters": asdict(walk.detection)}),
        },
        "gate": _describe_gate(walk, solution),
        "parameters": solution.parameters,
        "given": describe_given(walk, solution.method),
    }


def describe_given(walk: Walk, method: str) -> dict[str, object]:
    """Return the request, before anything was estimated from the walk, as `--config` reads it."""
    options, found = walk.options, get_method(method, walk.options.mount or "foot")  # None of somebody's own
    given = {name.removesuffix("_path"): getattr(options, name) for name in _GIVEN}
    return {
        "method": method,
        "mount": options.mount or "foot",
        **{name: _text(value) if isinstance(value, Path | MagAxes) else value for name, value in given.items()},
        "detector": {} if walk.detection is None else asdict(walk.detection),
        "parameters": found.parameters(options, walk.calibration) if found and found.parameters else {},
    }


def describe_recording(walk: Walk) -> dict[str, object]:
    """Return the recording, and what was applied to it."""
    recording, options, found = walk.recording, walk.options, walk.calibration
    calibration: dict[str, object] | None = None
    if found is not None:
        magnetometer, accelerometer, gyroscope = found.magnetometer, found.accelerometer, found.gyroscope
        calibration = {
            "file": _text(options.calibration_path),
            "made_from": found.recording,
            "corrected": walk.applied,
            "hard_iron_uT": None if magnetometer is None else magnetometer.hard_iron_uT,
            "correction": None if magnetometer is None else magnetometer.correction,
            "gyro_bias": None if gyroscope is None else gyroscope.prior,
            "acc_scale": None if accelerometer is None else accelerometer.scale,
            "acc_bias_m_s2": None if accelerometer is None else accelerometer.bias,
        }
    return {
        "recording": _text(recording.provenance.path),
        "format": recording.provenance.format,
        "samples": len(recording),
        "rate_hz": 1.0 / recording.period_s,
        "fixes": _text(options.fixes_path),
        "gnss": _text(options.gnss_path),
        "truth": _text(options.truth_path) or ("in the recording" if walk.truth is not None else None),
        "heading_deg": options.heading_deg,
        "use_magnetometer": options.use_magnetometer,
        "mag_axes": _text(options.mag_axes),
        "calibration": calibration,
    }


def _describe_gate(walk: Walk, solution: Solution) -> dict[str, object] | None:
    """Detector of the magnetic field, and its counts; None without one.

    A filter with a compass has its own detector, among its parameters.
    """
    words = solution.stances.field
    if walk.verdicts is None or "detector" in solution.parameters:
        return None
    detector = None if walk.options.gate == NO_GATE else find_gate(walk.options.gate)
    return {
        "name": walk.options.gate,
        "threshold": None if detector is None else detector.threshold,
        "judged": len(words) - words.count(UNKNOWN),
        "quasi_static": words.count(QUASI_STATIC),
        "parameters": detector,
    }


def _text(one: Path | MagAxes | None) -> str | None:
    return None if one is None else str(one)
