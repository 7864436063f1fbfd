"""Which wrong axes of a sensor in a pocket are seen in the strides of the thigh, and that its own are taken.

    python scripts/pocket_axes.py [--data DIR] [--pieces N] [--seed N] [--json FILE]

Of three real thighs (both upper legs of `qmt_fullbody`, the trouser leg of `ridi_leg`) and simulated ones, pieces of 10
to 50 s are cut at random; those with `FEWEST_STRIDES` are looked at, as they are, with an accelerometer that is off,
and with axes changed as in `plausible_solutions`; told is how many are doubtful and refused. Asked:
own axes refused in none, however the accelerometer is off, a mirror (the gyroscope negated) in all.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import harness
import numpy as np
import walks
from harness import Figure, option
from plausible_solutions import AXES, OWN
from verdicts import read_segment

from fg_nav.detection.handedness import DECISIVE, SUSPECT
from fg_nav.detection.swing_axes import FEWEST_STRIDES, measure_swing_axes
from fg_nav.frames import GRAVITY_M_S2
from fg_nav.io import read_raw
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.recording import RawRecording, Recording

SHORTEST_S, LONGEST_S = 15.0, 50.0
SIMULATED = 3
MIRROR = "gyroscope negated"

OFF: Mapping[str, Callable[[RawRecording], RawRecording]] = {
    "scale + 3 %": lambda raw: replace(raw, acc=1.03 * raw.acc),
    "scale - 3 %": lambda raw: replace(raw, acc=0.97 * raw.acc),
    "bias + 0.3 m/s^2 an axis": lambda raw: replace(raw, acc=raw.acc + 0.3),
    "bias - 0.3 m/s^2 an axis": lambda raw: replace(raw, acc=raw.acc - 0.3),
}
"""Accelerometers."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Look at all pieces, and print the figures."""
    chosen = harness.parse_arguments(
        __doc__, arguments, data=None, pieces=option(5, "of each recording"), seed=1, json=None
    )
    rng, looked, doubtful, refused = np.random.default_rng(chosen.seed), Counter[str](), Counter[str](), Counter[str]()
    off = defaultdict[str, list[float]](list)
    for recording in list_thighs(walks.data_folder(chosen.data)):
        for piece in (cut(recording, rng) for _ in range(chosen.pieces)):
            for name, change in {OWN: lambda raw: raw, **OFF, **AXES}.items():
                raw = change(piece)
                evidence = measure_swing_axes(raw.t, raw.acc, raw.gyr)
                if evidence.strides >= FEWEST_STRIDES:
                    looked[name] += 1
                    doubtful[name] += SUSPECT < evidence.against <= DECISIVE
                    refused[name] += evidence.against > DECISIVE
                    off[name].append(float(np.median(evidence.gravity)) - GRAVITY_M_S2)
    harness.print_table(
        ("pieces", "with strides", "doubtful", "refused", "mean force - g, m/s^2"),
        [
            (name, str(n), str(doubtful[name]), str(refused[name]), f"{min(off[name]):+.2f} to {max(off[name]):+.2f}")
            for name, n in looked.items()
        ],
    )
    asked = {**dict.fromkeys((OWN, *OFF), (0.0, 0.0)), MIRROR: (looked[MIRROR], looked[MIRROR])}
    figures = [
        Figure("thighs", f"{name} refused, of {looked[name]}", "pocket", refused[name], *limits, pattern="{:.0f}")
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
