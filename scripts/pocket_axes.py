"""Wrong axes and signs of a sensor in a pocket are seen in the strides of the thigh, its own are taken: of how many.

    python scripts/pocket_axes.py [--data DIR] [--pieces N] [--seed N] [--json FILE]

Of three real thighs (both upper legs of `qmt_fullbody`, the trouser leg of `ridi_leg`) and simulated ones, pieces of 10
to 50 s are cut at random; those with `FEWEST` strides are looked at, as they are, and with axes changed as in
`plausible_solutions`. Asked: own axes refused in none, a mirror (the gyroscope negated) in all.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

import harness
import numpy as np
import walks
from harness import Figure, option
from plausible_solutions import AXES, OWN
from verdict_recordings import read_segment

from fg_nav.detection.handedness import DECISIVE
from fg_nav.detection.swing_axes import measure_swing_axes
from fg_nav.io import read_raw
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.recording import RawRecording, Recording

FEWEST = 5
SHORTEST_S, LONGEST_S = 10.0, 50.0
SIMULATED = 3
MIRROR = "gyroscope negated"


def main(arguments: Sequence[str] | None = None) -> None:
    """Look at all pieces, and print the figures."""
    chosen = harness.parse_arguments(
        __doc__, arguments, data=None, pieces=option(5, "of each recording"), seed=1, json=None
    )
    rng, looked, found = np.random.default_rng(chosen.seed), Counter[str](), Counter[str]()
    for recording in list_thighs(walks.data_folder(chosen.data)):
        for piece in (cut(recording, rng) for _ in range(chosen.pieces)):
            for name, change in {OWN: lambda raw: raw, **AXES}.items():
                raw = change(piece)
                evidence = measure_swing_axes(raw.t, raw.acc, raw.gyr)
                looked[name] += evidence.strides >= FEWEST
                found[name] += evidence.against > DECISIVE
    harness.print_table(
        ("pieces", "with strides", "refused"), [(name, str(count), str(found[name])) for name, count in looked.items()]
    )
    asked = {OWN: (0.0, 0.0), MIRROR: (looked[MIRROR], looked[MIRROR])}
    figures = [
        Figure("thighs", f"{name} refused, of {looked[name]}", "pocket", found[name], *limits, pattern="{:.0f}")
        for name, limits in asked.items()
    ]
    harness.print_figures(figures)
    harness.print_verdict(figures, chosen.json)


def list_thighs(data: Path) -> Iterator[Recording]:
    """Real ones first."""
    for name in ("upper_leg_left", "upper_leg_right"):
        yield Recording.from_raw(read_segment(data, name))
    yield Recording.from_raw(read_raw(data / "ridi_leg" / "zhicheng_leg2.csv"))
    for seed in range(301, 301 + SIMULATED):
        yield simulate("demo", seed, Choices(worn="pocket", rate_hz=100.0)).recording


def cut(recording: Recording, rng: np.random.Generator) -> RawRecording:
    """Cut out a piece at random."""
    length = rng.uniform(SHORTEST_S, LONGEST_S)
    first = recording.t[0] + rng.uniform(0.0, max(recording.duration_s - length, 0.0))
    part = np.flatnonzero((recording.t >= first) & (recording.t < first + length))
    return RawRecording(recording.t[part], recording.acc[part], recording.gyr[part], part)


if __name__ == "__main__":
    harness.run(main)
