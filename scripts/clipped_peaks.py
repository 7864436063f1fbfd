"""What a sensor hides that cuts its peaks, and what is left when they are rebuilt (`fg_nav.samples.peaks`).

    python scripts/clipped_peaks.py [RECORDING ...] [--strides N] [--seed N] [--mount NAME] [--rate HZ]

The axis that turns fastest is cut at a share of its median peak, and so is the one that is pushed most. What is hidden
is the angle of each peak, in degrees, or its change of velocity, in m/s: of simulated noise-free strides, or of
recordings whose sensor did not clip. What is left over its sigma is 1 where the sigma is true.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import figures as fig
import numpy as np
from lost_samples import walk

from fg_nav.arrays import Floats
from fg_nav.io import read
from fg_nav.lab.simulation.person import MOUNTS, mount_named
from fg_nav.samples.peaks import rebuilt

SHARES = (0.95, 0.85, 0.7, 0.5)


def main(arguments: Sequence[str] | None = None) -> None:
    """Cut, rebuild, print."""
    parser = argparse.ArgumentParser(description="What clipped peaks hide, and what rebuilding them leaves.")
    parser.add_argument("recordings", nargs="*", type=Path, metavar="RECORDING", help="in place of a simulated walk")
    parser.add_argument("--strides", type=int, default=200, metavar="N", help="of a walk (200)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="draws strides and motion (1)")
    parser.add_argument("--mount", default="instep", help=f"{' or '.join(MOUNTS)}")
    parser.add_argument("--rate", type=float, default=200.0, metavar="HZ", help="of the samples (200)")
    chosen = parser.parse_args(arguments)
    walks = [(path.name, *_recorded(path)) for path in chosen.recordings]
    if not walks:
        walked = walk(chosen.strides, mount_named(chosen.mount), chosen.rate, np.random.default_rng(chosen.seed))
        walks = [("simulated", walked.gyr, walked.acc, walked.period_s)]
    columns = ("walk", "cut at", "peaks", "hidden", "left when rebuilt", "over sigma")
    fig.print_heading("Angle hidden in a clipped peak, rms, deg")
    fig.print_table(columns, [row for name, gyr, _, period_s in walks for row in rows(name, np.degrees(gyr), period_s)])
    fig.print_heading("Change of velocity hidden in a clipped peak, rms, m/s")
    fig.print_table(columns, [row for name, _, acc, period_s in walks for row in rows(name, acc, period_s)])


def _recorded(path: Path) -> tuple[Floats, Floats, float]:
    recording = read(path)
    return recording.gyr, recording.acc, recording.period_s


def rows(name: str, samples: Floats, period_s: float) -> list[list[str]]:
    """One row a level, of rates in deg/s or of forces in m/s^2, (N, 3)."""
    axis = int(np.argmax(np.abs(samples).max(axis=0)))
    median = median_peak(np.abs(samples[:, axis]))
    table = []
    for share in SHARES:
        cut = samples.copy()
        cut[:, axis] = np.clip(samples[:, axis], -share * median, share * median)
        found = rebuilt(cut, period_s)
        hidden = by_peak(samples[:, axis], cut[:, axis], cut[:, axis], period_s)
        left = by_peak(samples[:, axis], found.whole[:, axis], cut[:, axis], period_s)
        variance = by_peak(found.sigma[:, axis] ** 2, np.zeros(len(cut)), cut[:, axis], period_s) * period_s
        over_sigma = np.sqrt(np.mean(left[variance > 0] ** 2 / variance[variance > 0]))
        rms = [f"{np.sqrt(np.mean(some**2)):.2f}" for some in (hidden, left)]
        table.append([name, f"{100 * share:.0f} %", str(len(hidden)), *rms, f"{over_sigma:.2f}"])
    return table


def median_peak(size: Floats) -> float:
    """Median of the peaks of a size (N,) that reach half of the highest."""
    high = size > size.max() / 2
    return float(np.median([size[a:b].max() for a, b in _runs(high)]))


def by_peak(whole: Floats, found: Floats, cut: Floats, period_s: float) -> Floats:
    """Angle or change of velocity (P,) by which `found` (N,) misses each peak that was cut."""
    clipped = np.abs(cut) >= np.abs(cut).max()
    return np.array([(whole - found)[a:b].sum() * period_s for a, b in _runs(clipped)])


def _runs(flags: Floats) -> list[tuple[int, int]]:
    edge = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edge[::2].tolist(), edge[1::2].tolist(), strict=True))


if __name__ == "__main__":
    fig.leave_with(main)
