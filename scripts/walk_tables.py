"""Tables of the walks for README and docs, of the files that `real_walks.py` and `sigma_coverage.py` write."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from beside import SUMMARIES, is_worse
from joint_errors import FREEDOM
from real_fields import MERITS
from real_walks import (
    AIR,
    CORRIDOR,
    FOOTPRINTS,
    IEZ,
    LOOPS,
    MEMS,
    MTIG,
    NEES,
    PYSHOE,
    RMSE,
    ROUND,
    RUN,
    SETS_BESIDE,
    SPACE,
    STAIRS,
    STORED,
    SURVEYED,
    VICON_DETECTED,
    VICON_LABELLED,
)
from real_walks import SMOOTHER as INERTIAL
from walks import GDIN

from fg_nav.verdict import UNUSABLE


def write_row(cells: Sequence[str]) -> str:
    """Row of a table in Markdown."""
    return "| " + " | ".join(_in_table(cell) for cell in cells) + " |"


def _in_table(text: str) -> str:
    """What would end a cell, or be taken for a tag, is written so that it is not."""
    return re.sub(r"<(?=[A-Za-z/!])", "&lt;", text.replace("|", "\\|").replace("\n", " "))


Walks = Mapping[str, Any]
"""Content of `real-walks.json`."""

LOOPS_WALKED = "5 loops of 23 to 78 m"


def write_summary(walks: Walks) -> list[str]:
    """Figures of all sets, a line each."""
    footprints = [of_pairs(walks, "without"), of_pairs(walks, "raw"), of(walks, FOOTPRINTS, IEZ, RMSE), "-"]
    vicon = [of(walks, VICON_LABELLED, method, RMSE) for method in (INERTIAL, IEZ)]
    own = [of(walks, VICON_DETECTED, method, SPACE, summaries=(*MEAN, *P95)) for method in (INERTIAL, IEZ)]
    loops = [of(walks, LOOPS, method, "closure_percent", "{:.2f}", WORST) for method in (INERTIAL, IEZ)]
    gdin = "10 indoor walks of 35 to 150 m (`gdin`): rmse at surveyed footprints, mean / median (m)"
    surveyed = {"11 indoor walks of 10 to 120 m": SURVEYED, "7 runs, or gyroscope clipped": RUN}
    return [
        "| | `inertial` | `smoother`, with the compass | `iez` | PyShoe |",
        "|---|---:|---:|---:|---:|",
        write_row(["28 motion-captured trials: rmse 2-D, mean / median (m)", vicon[0], "-", vicon[1], PYSHOE_2D]),
        write_row(["the same, own stances: rmse 3-D, mean / median / 95 % below (m)", own[0], "-", own[1], "-"]),
        write_row([gdin, *footprints]),
        *(write_row([f"{what} (`gdlbio`): the same", *_of_stored(walks, part)]) for what, part in surveyed.items()),
        write_row([f"{LOOPS_WALKED}: closure in % of the distance, median / worst", loops[0], "-", loops[1], "-"]),
        *(write_row([words, ours, "-", filtered, "-"]) for words, ours, filtered in _closures(walks)),
    ]


CLOSED = {
    ROUND: "12 rounds of 43 m at 100 Hz, walked, run, mixed (`mti1_loops`)",
    STAIRS: "12 walks on stairs of one to three floors, up and down (`mti1_loops`)",
    CORRIDOR: "a corridor to and fro, 89 m (`corridor_lab`)",
    MEMS: "13 laps, squares and rectangles of 38 to 365 m (`mems_foot`)",
}


def _closures(walks: Walks) -> list[tuple[str, ...]]:
    """Name and figures of the closed sets that are more than one walk: the two of one sensor in one line."""
    mean = [
        [of(walks, part, one, "ground_m", summaries=MEAN[:1]) for part in (ROUND, STAIRS)] for one in (INERTIAL, IEZ)
    ]
    mti = "12 rounds of 43 m / 12 walks on stairs, 100 Hz (`mti1_loops`): closure over the ground, mean (m)"
    mems = [of(walks, MEMS, method, "ground_m") for method in (INERTIAL, IEZ)]
    return [(mti, *map(" / ".join, mean)), (f"{CLOSED[MEMS]}: the same, mean / median", *mems)]


def write_closed(walks: Walks) -> list[str]:
    """Ends of closed walks over the ground and up, each over its sigma, and the verdicts."""
    lines = [write_row(CLOSED_HEADERS), "|---|---|---:|---:|---:|---:|---|"]
    parts = {**CLOSED, MEMS + AIR: "the same with their barometer"}
    for part, what in parts.items():
        for method in (INERTIAL, IEZ) if AIR not in part else (INERTIAL,):
            ends = [of(walks, part, method, name, pattern, some) for name, pattern, some in CLOSED_MERITS]
            words = [one.get("verdict", "failed") for one in rows_of(walks, part, method)]
            verdicts = " / ".join(str(words.count(word)) for word in ("trusted", "doubtful", UNUSABLE))
            lines.append(write_row([what, NAMES[method], *ends, verdicts]))
    return lines


def write_passes(walks: Walks) -> list[str]:
    """Start to end of each recording of mtig."""
    lines = [write_row(PASS_HEADERS), "|---|" + "---:|" * (len(PASS_HEADERS) - 1)]
    found = {part: {one["walk"]: one for one in rows_of(walks, part, INERTIAL)} for part in (MTIG, MTIG + AIR)}
    filtered = {one["walk"]: one for one in rows_of(walks, MTIG, IEZ)}
    for walk, plain in found[MTIG].items():
        aided = found[MTIG + AIR][walk]
        cells = [cell for one in (plain, aided) for cell in (f"{one['ground_m']:.2f}", _height(one))]
        lines.append(
            write_row([f"`{walk}`", *cells, f"{filtered[walk].get('ground_m', math.inf):.2f}", plain["verdict"]])
        )
    return lines


def _height(row: Mapping[str, Any]) -> str:
    return f"{row['z_m']:+.2f} ± {abs(row['z_m'] / row['z_ratio']):.2f}"


def write_behind(walks: Walks) -> list[str]:
    """Return the walks of all sets on which the smoother is behind the filter."""
    lines = ["| set | walk | `inertial`, m | `iez`, m |", "|---|---|---:|---:|"]
    for name, (parts, begin) in SETS_BESIDE.items():
        both = {
            method: {
                one["walk"]: one.get(RMSE, one.get("ground_m", math.inf))
                for part in parts
                for one in rows_of(walks, part, method)
            }
            for method in (INERTIAL, IEZ)
        }
        for walk, ours in both[INERTIAL].items():
            other = both[IEZ][walk]
            if walk.startswith(begin) and is_worse(ours, other):
                lines.append(write_row([name, walk, f"{ours:.3f}", f"{other:.3f}"]))
    return lines


def write_bias_walk(walks: Walks) -> list[str]:
    """Error and sigma at the end, a line a walk and a column a level."""
    rows = walks.get("bias_walk", [])  # a part of its own, which may not have been measured
    levels = list(dict.fromkeys(row["level"] for row in rows))
    lines = [write_row(["end off / sigma, m", *levels]), "|---|" + "---:|" * len(levels)]
    for walk in dict.fromkeys(row["walk"] for row in rows):
        some = {row["level"]: f"{row['error_m']:.2f} / {row['sigma_m']:.2f}" for row in rows if row["walk"] == walk}
        lines.append(write_row([walk, *(some[level] for level in levels)]))
    return lines


def _of_stored(walks: Walks, section: str) -> tuple[str, ...]:
    ours, filtered, stored = (of(walks, section, method, RMSE) for method in (INERTIAL, IEZ, STORED))
    return ours, "-", filtered, stored


def write_vicon(walks: Walks) -> list[str]:
    """Figures of the motion-captured trials."""
    rows = {
        "PyShoe's labels as stances: rmse 2-D, mean / median (m)": (VICON_LABELLED, RMSE, "{:.3f}", MEAN, PYSHOE_2D),
        "the same, rmse 3-D": (VICON_LABELLED, SPACE, "{:.3f}", MEAN, PYSHOE_3D),
        "the same, rmse 3-D, 95 % of the trials below": (VICON_LABELLED, SPACE, "{:.3f}", P95, "-"),
        "the same, best-fit scale, median": (VICON_LABELLED, "scale", "{:.4f}", MIDDLE, "-"),
        "the same, NEES of the positions over its expectation, median": (VICON_LABELLED, NEES, "{:.2f}", MIDDLE, "-"),
        "own stances: rmse 2-D, mean / median (m)": (VICON_DETECTED, RMSE, "{:.3f}", MEAN, "-"),
        "the same, rmse 3-D, mean / median": (VICON_DETECTED, SPACE, "{:.3f}", MEAN, "-"),
        "the same, rmse 3-D, 95 % of the trials below / worst": (VICON_DETECTED, SPACE, "{:.3f}", (*P95, max), "-"),
    }
    return _of_both(walks, rows)


def write_indoor(walks: Walks) -> list[str]:
    """Figures of the indoor walks and loops."""
    rows = {
        "10 `gdin` walks of 35 to 150 m: footprint rmse, mean / median (m)": (FOOTPRINTS, RMSE, "{:.3f}", MEAN, ""),
        "the same, median / worst walk": (FOOTPRINTS, RMSE, "{:.2f}", WORST, ""),
        "the same, best-fit scale, median": (FOOTPRINTS, "scale", "{:.3f}", MIDDLE, ""),
        f"{LOOPS_WALKED}: closure in % of the distance, median / worst": (
            LOOPS, "closure_percent", "{:.2f}", WORST, "",
        ),
    }  # fmt: skip
    return _of_both(walks, rows)


def _of_both(walks: Walks, rows: Mapping[str, tuple[str, str, str, Sequence[Summary], str]]) -> list[str]:
    beside = any(row[-1] for row in rows.values())
    lines = ["| | `inertial` | `iez` |" + " PyShoe |" * beside, "|---|---:|---:|" + "---:|" * beside]
    for words, (section, name, pattern, summaries, other) in rows.items():
        both = [of(walks, section, method, name, pattern, summaries) for method in (INERTIAL, IEZ)]
        lines.append(write_row([words, *both, *([other] if beside else [])]))
    return lines


def write_pairs(walks: Walks) -> list[str]:
    """Each walk without and with the magnetometer."""
    lines = ["| walk | without | as recorded | calibrated on the walk |", "|---|---:|---:|---:|"]
    for group, merit in MERITS.items():
        some = [pair for pair in walks["magnetometer"] if pair["group"] == group]
        rows = {f"{group} {pair['name']}": [pair[kind] for kind in KINDS] for pair in some}
        rows[f"{group}, mean: {merit}"] = np.mean(list(rows.values()), axis=0).tolist()
        lines += [write_row([name, *(f"{value:.3f}" for value in values)]) for name, values in rows.items()]
    return lines


def write_ablation(walks: Walks) -> list[str]:
    """The smoother without one of its parts."""
    rows = walks["ablation"]
    lines = [write_row(list(rows[0])), "|---|" + "---:|" * (len(rows[0]) - 1)]
    return lines + [write_row([_cell(cell) for cell in row.values()]) for row in rows]


def _cell(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)


Summary = Callable[[Sequence[float]], float]
MEAN: Sequence[Summary] = (statistics.fmean, statistics.median)
WORST: Sequence[Summary] = (statistics.median, max)
MIDDLE: Sequence[Summary] = (statistics.median,)
P95: Sequence[Summary] = (SUMMARIES["p95"],)
MEAN_WORST: Sequence[Summary] = (statistics.fmean, max)
RMS: Sequence[Summary] = (SUMMARIES["rms"],)
CLOSED_MERITS: Sequence[tuple[str, str, Sequence[Summary]]] = (
    ("ground_m", "{:.2f}", MEAN_WORST),
    ("ground_ratio", "{:.2f}", RMS),
    ("z_m", "{:.2f}", MEAN_WORST),
    ("z_ratio", "{:.2f}", RMS),
)
CLOSED_HEADERS = ("", "method", "closure over the ground, mean / worst (m)", "over its sigma, rms")
CLOSED_HEADERS += ("height at the end, mean / worst (m)", "over its sigma, rms", "trusted / doubtful / not to be used")
PASS_HEADERS = ("recording", "start to end (m)", "z (m)", "with barometer (m)", "z (m)", "`iez` (m)", "verdict")
NAMES = {INERTIAL: "`inertial`", IEZ: "`iez`"}
KINDS = ("without", "raw", "walk")
PYSHOE_2D, PYSHOE_3D = (" / ".join(f"{PYSHOE[of][plane]:.3f}" for of in ("mean", "median")) for plane in (0, 1))


def of(
    walks: Walks,
    section: str,
    method: str,
    name: str,
    pattern: str = "{:.3f}",
    summaries: Sequence[Summary] = MEAN,
) -> str:
    """A figure of merit over the walks of a section, if there are some; a walk that failed is infinitely bad."""
    values = [abs(one.get(name, math.inf)) for one in rows_of(walks, section, method)]
    return " / ".join(pattern.format(summary(values)) for summary in summaries) if values else "-"


def rows_of(walks: Walks, section: str, method: str) -> list[Mapping[str, Any]]:
    """Walks of a section by one method."""
    return [one for one in walks["walks"] if (one["section"], one["method"]) == (section, method)]


def of_pairs(walks: Walks, kind: str) -> str:
    """Mean and median over the gdin walks without the magnetometer, or with it."""
    values = [pair[kind] for pair in walks["magnetometer"] if pair["group"] == GDIN]
    return " / ".join(f"{summary(values):.3f}" for summary in MEAN)


def write_coverage(content: Mapping[str, Any]) -> list[str]:
    """Shares of errors in the region of 95 % and error over sigma, one row a section of `coverage.json`."""
    lines = [write_row(["", "walks", *FREEDOM]), "|---|---:|" + "---:|" * len(FREEDOM)]
    for section in dict.fromkeys(walk["section"] for walk in content["walks"]):
        some = [walk for walk in content["walks"] if walk["section"] == section]
        figures = {one["name"]: one for one in content["figures"] if one["section"] == section}
        cells = [_of_coverage(figures.get(name), [walk[name] for walk in some if name in walk]) for name in FREEDOM]
        lines.append(write_row([section, f"{len(some)}", *cells]))
    return lines


def _of_coverage(figure: Mapping[str, Any] | None, found: Sequence[Mapping[str, Any]]) -> str:
    if figure is None:
        return "-"
    ratio = statistics.median(one["ratio"] for one in found)
    missed = ", missed" if figure["mark"] == "missed" else ""
    return f"{figure['measured']:.0%}, {ratio:.2f}{missed}"


PEER_COLUMNS = {
    "walks": "{}",
    "over_bare": "{:.2f}",
    "us_a_sample": "{:.2f}",
    "rmse_2d_m": "{:.3f}",
    "rmse_3d_m": "{:.3f}",
    "closure_m": "{:.2f}",
    "heading_deg": "{:.2f}",
    "inclination_deg": "{:.2f}",
}
PEER_HEADERS = (
    *("set", "program", "walks", "over the bare loop", "us a sample", "2-D (m)", "3-D (m)", "start to end (m)"),
    *("heading (deg)", "inclination (deg)", "leaves out"),
)


def write_peers(content: Mapping[str, Any]) -> list[str]:
    """Write speed, errors and scope of each program, one row a set; `content` is that of `benchmark.json`."""
    lines = [write_row(list(PEER_HEADERS)), "|---|---|" + "---:|" * len(PEER_COLUMNS) + "---|"]
    for row in content["peers"]:
        cells = ["-" if row[name] is None else pattern.format(row[name]) for name, pattern in PEER_COLUMNS.items()]
        scope = f"not measured: {row['missing']}" if row["over_bare"] is None else row["leaves_out"]
        lines.append(write_row([row["set"], f"{row['method']} {row['version']}".strip(), *cells, scope]))
    return lines
