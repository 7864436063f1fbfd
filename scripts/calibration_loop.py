"""Ma's calibration on the shoe against his Table 1 and his Figure 7, on the simulated loop.

    python scripts/calibration_loop.py [--seeds N] [--field LEVEL]

What is measured, and with which calibrations, is in `fg_nav.lab.reproduce.ma2018.loop`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import figures as fig
import numpy as np

from fg_nav.arrays import Floats
from fg_nav.lab.reproduce.ma2018.loop import CLSEF, ELLIPSES, MG_PER_UT, Loop, heading_errors, walked_loop

FIRST_SEED = 101


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Ma's calibration on the shoe: Table 1 and Figure 7.")
    parser.add_argument("--seeds", type=int, default=20, metavar="N", help="walks, from seed 101 on")
    parser.add_argument("--field", default="homogeneous", metavar="LEVEL", help="homogeneous, smooth or indoor")
    chosen = parser.parse_args(arguments)
    loops = [walked_loop(seed, chosen.field) for seed in range(FIRST_SEED, FIRST_SEED + chosen.seeds)]
    print_recovery(loops)
    print_headings(loops)
    fig.print_verdict(asked_of(loops))


def print_recovery(loops: Sequence[Loop]) -> None:
    """Table 1: errors by method, median and range over the walks on which it does not refuse."""
    fig.print_heading(f"Table 1: error of what is recovered, median [least, most] of {len(loops)} walks")
    rows = []
    for name in ELLIPSES:
        offset, eta, tau = found = np.array([loop.recovery[name] for loop in loops]).T
        told = spread(MG_PER_UT * offset, "{:.1f}"), spread(eta, "{:.3f}"), spread(tau, "{:.3f}")
        rows.append((name, *told, f"{np.isinf(found[0]).sum()}"))
    fig.print_table(("method", "offset (mG)", "eta (rad)", "tau", "refused"), rows)
    sigmas = np.array([loop.sigma for loop in loops])
    known = np.isfinite(sigmas).all(axis=1)
    if not known.any():
        return
    sigma = np.median(sigmas[known], axis=0)
    told = f"{MG_PER_UT * max(sigma[:2]):.1f} mG, {sigma[2]:.3f} rad, {sigma[3]:.3f}"
    print(f"the fitted ellipse's own sigmas: {told}; footfalls: {np.median([loop.footfalls for loop in loops]):.0f}")


def print_headings(loops: Sequence[Loop]) -> None:
    """Figure 7: heading differences by method, of the walks on which it does not refuse."""
    fig.print_heading("Figure 7: magnetic minus gyro heading, deg, median [least, most] of the walks")
    rows = []
    for name in loops[0].heading:
        largest, rms = heading_errors(loops, name)
        rows.append((name, spread(largest, "{:.1f}"), spread(rms, "{:.1f}"), f"{np.isinf(rms).sum()}"))
    fig.print_table(("calibration", "largest", "rms", "refused"), rows)


def spread(values: Floats, pattern: str) -> str:
    """Median, least and most of those that are finite."""
    values = values[np.isfinite(values)]
    if not len(values):
        return "-"
    middle, least, most = (pattern.format(f(values)) for f in (np.median, np.min, np.max))
    return f"{middle} [{least}, {most}]"


def asked_of(loops: Sequence[Loop]) -> list[fig.Figure]:
    """What issue 4 asks of the fitted ellipse."""
    name = "ellipse, fitted"
    offset, eta, tau = np.median([loop.recovery[name] for loop in loops], axis=0)
    largest, _ = heading_errors(loops, name)
    bare, _ = heading_errors(loops, CLSEF)
    return [
        fig.Figure("Table 1", "offset (mG)", name, MG_PER_UT * float(offset), high=3.0),
        fig.Figure("Table 1", "eta (rad)", name, float(eta), high=0.03),
        fig.Figure("Table 1", "tau", name, float(tau), high=0.02),
        fig.Figure("Figure 7", "largest difference (deg)", name, float(np.median(largest)), high=5.0),
        fig.Figure("Figure 7", "CLSEF's largest over ours", "both", float(np.median(bare / largest)), low=1.0),
    ]


if __name__ == "__main__":
    fig.leave_with(main)
