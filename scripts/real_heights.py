"""Heights of real walks with a barometer, without and with it.

    python scripts/real_heights.py [--jobs N] [--json FILE]

============ ========================================================================================================
closed       mems_foot, rounds of one floor, and mtig710, corridors and a round: height at the end, m, which is 0
stairs       mtig710, one staircase up and down: their heights, m, of which the sum is 0
============ ========================================================================================================

"/ sigma" is the height over its claimed sigma; the magnetometer is not used. The length of the path must not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import harness
import numpy as np
import walks

from fg_nav.detection import detect_stances
from fg_nav.io import read
from fg_nav.smoother import smooth
from fg_nav.smoother.parameters import SmootherParameters, WalkParameters

MTIG = "mtig710/2022_1_"
CLOSED = (
    *(f"mems_foot/lap_360m_{k}" for k in (1, 2, 3)),
    *(f"mems_foot/square_70m_{k}" for k in range(1, 7)),
    *(f"mems_foot/{name}" for name in ("rectangle_1", "rectangle_3", "large_rectangle_1", "line_60m_1", "line_60m_2")),
    *(f"{MTIG}{name}" for name in ("14_hallway_walk3", "13_straight_walk_foot1", "13_straight_run_foot2")),
)
STAIRS = tuple(f"{MTIG}14_stair_walk_{way}_foot1" for way in ("up", "down"))


@dataclass(frozen=True)
class Measured:
    """Height at the end and its sigma, and the length of the path, m."""

    height: float
    sigma: float
    length: float


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    chosen = harness.parse_arguments(__doc__, arguments, data=None, jobs=2, json=None)
    data = walks.data_folder(chosen.data)
    tasks = [(name, with_air) for name in (*CLOSED, *STAIRS) for with_air in (False, True)]
    found = dict(zip(tasks, harness.map_walks(partial(measure, data=data), tasks, chosen.jobs), strict=True))
    rows = [_row(name, found[name, False], found[name, True]) for name in (*CLOSED, *STAIRS)]
    harness.print_table(("walk", "without (m)", "/ sigma", "with (m)", "/ sigma", "length (m)", "with (m)"), rows)
    for with_air, words in ((False, "without"), (True, "with")):
        ratio = np.array([found[name, with_air].height / found[name, with_air].sigma for name in CLOSED])
        size = np.abs([found[name, with_air].height for name in CLOSED])
        up, down = (found[name, with_air].height for name in STAIRS)
        print(
            f"{words} a barometer: |height| at the end of closed walks median {np.median(size):.2f}, largest "
            f"{size.max():.2f} m; "
            f"over sigma rms {np.sqrt((ratio**2).mean()):.2f}, median {np.median(np.abs(ratio)):.2f}; "
            f"stairs up and down differ by {abs(up + down):.2f} m"
        )
    if chosen.json is not None:
        harness.write_json(chosen.json, {f"{name} {with_air}": vars(one) for (name, with_air), one in found.items()})


def measure(task: tuple[str, bool], data: Path) -> Measured:
    """Smooth a walk with or without its barometer."""
    name, with_air = task
    recording = read(data / f"{name}.csv.gz", barometer=data / f"{name}.baro.csv.gz")
    parameters = SmootherParameters(walk=WalkParameters(barometer=with_air))
    recording = replace(recording, mag=None)
    table = smooth(recording, detect_stances(recording), parameters).stances
    length = float(np.linalg.norm(np.diff(table.position[:, :2], axis=0), axis=1).sum())
    return Measured(float(table.position[-1, 2]), float(np.sqrt(table.position_cov[-1, 2, 2])), length)


def _row(name: str, plain: Measured, aided: Measured) -> list[str]:
    cells = [f"{value:.2f}" for one in (plain, aided) for value in (one.height, one.height / one.sigma)]
    return [name, *cells, f"{plain.length:.2f}", f"{aided.length:.2f}"]


if __name__ == "__main__":
    main()
