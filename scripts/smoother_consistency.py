"""Are the smoother's sigmas of place and heading true? NEES on simulated walks, in a homogeneous and a disturbed field.

    python scripts/smoother_consistency.py --out DIR [--methods NAME ...] [--scenarios NAME ...] [--fields LEVEL ...]
        [--seeds N] [--first SEED] [--magnetometer loop|perfect] [--jobs N]

Results are those of `compare_ekf`, kept in the same folder, and taken up again. All methods are told the true heading
at the start, so nothing is fitted; `fg_nav.evaluation.consistency` has the errors, their parts and the bands.

============== ======================================================================================================
end            share of the seeds whose NEES at the last footfall lies within the two-sided 95 % band
mean           the same of the mean over four footfalls (1/4, 1/2, 3/4 of the walk, and its end), with the band that
               their correlation leaves
too large      share of the seeds above the upper end of the band at the last footfall: who is too sure
NEES / n       mean over the seeds at the last footfall over its expectation: ruled by the worst walks
error / sigma  rms over the seeds and the four footfalls: by how much the true spread is larger than the claimed one
============== ======================================================================================================

`pose` is place and heading together, `ground` the same without height. A claim without the cross terms of the two has
no such figures; then the two are judged apart, and the lesser share counts. Asked: at least 80 % of the seeds, at the
end and in the mean. Of 20 honest walks 19 are expected inside, and 16 or more in 99.7 % of all cases.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import compare_ekf
import harness
import numpy as np
from compare_tables import BUILDING, MALL, OFFICE, OFFICE_OPEN, print_remarks
from harness import Figure

from fg_nav.arrays import Floats
from fg_nav.evaluation.consistency import PARTS, PLACES, estimate_freedom_of_mean, nees_band, share_in_band
from fg_nav.lab.campaign.walks import LOOP, PERFECT
from fg_nav.lab.store.results import Result

FIRST_SEED, SEEDS = 101, 20
METHODS = ("inertial", "smoother")
SCENARIOS, FIELDS = (OFFICE, OFFICE_OPEN, BUILDING, MALL), ("homogeneous", "smooth", "indoor")
LEAST_SHARE = 0.8
FEWEST = 3
"""Seeds below which a correlation over seeds is none."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make what is missing, print, judge."""
    chosen = _parse(arguments)
    results = compare_ekf.made_and_kept(chosen)
    cases: dict[str, list[Result]] = {}
    for result in results:
        key = result.key
        cases.setdefault(f"{key.group}, {key.field}, {key.method}", []).append(result)
    harness.print_heading(f"Share of {len(chosen.seeds)} walks within the 95 % band, by part; magnetometer {LOOP}")
    harness.print_table(*share_table(cases))
    harness.print_heading("Error over claimed sigma, rms; NEES at the end over its expectation, mean")
    harness.print_table(*ratio_table(cases))
    figures = [figure for name, some in cases.items() for figure in judged(name, some)]
    harness.print_verdict(figures)
    print_remarks(results)


def _parse(arguments: Sequence[str] | None) -> compare_ekf.Chosen:
    parser = argparse.ArgumentParser(description="Are the smoother's sigmas true?")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of the results")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), metavar="NAME[:PRESET]")
    parser.add_argument("--scenarios", nargs="+", default=list(SCENARIOS), metavar="NAME")
    parser.add_argument("--fields", nargs="+", default=list(FIELDS), metavar="LEVEL")
    parser.add_argument("--seeds", type=int, default=SEEDS, metavar="N", help=f"walks of a scenario ({SEEDS})")
    parser.add_argument("--first", type=int, default=FIRST_SEED, metavar="SEED", help=f"the first ({FIRST_SEED})")
    parser.add_argument("--magnetometer", default=LOOP, choices=(LOOP, PERFECT))
    parser.add_argument("--jobs", type=int, default=2, metavar="N", help="processes (2)")
    given = parser.parse_args(arguments)
    seeds = range(given.first, given.first + given.seeds)
    chosen = compare_ekf.Chosen(
        given.methods, given.scenarios, given.fields, (given.magnetometer,), seeds, (), given.out, given.jobs
    )
    return compare_ekf.checked(chosen)


def whitened(some: Sequence[Result]) -> dict[str, Floats]:
    """Errors over their claim (S, M, n) by part, of the walks that have one."""
    known = [result.whitened for result in some if result.whitened]
    parts = [part for part in PARTS if all(part in one for one in known)]
    return {part: np.array([one[part] for one in known], dtype=np.float64) for part in parts} if known else {}


def share_at_end(z: Floats) -> float:
    """Share of seeds whose NEES at the last footfall is inside the band; z (S, M, n)."""
    n = z.shape[2]
    return share_in_band((z[:, -1] ** 2).sum(axis=1), n, n)


def share_above(z: Floats) -> float:
    """Share of seeds whose NEES at the last footfall is above the band."""
    n = z.shape[2]
    return float(np.mean((z[:, -1] ** 2).sum(axis=1) > nees_band(n, n)[1]))


def share_of_mean(z: Floats) -> float:
    """Share of seeds whose mean NEES over the footfalls is inside its band; NaN of too few seeds."""
    seeds, _, n = z.shape
    if seeds < FEWEST:
        return math.nan
    return share_in_band((z**2).sum(axis=2).mean(axis=1), estimate_freedom_of_mean(z), n)


def share_table(cases: Mapping[str, Sequence[Result]]) -> tuple[list[str], list[list[str]]]:
    """Head and one row a case: end / mean / too large, of each part."""
    rows = []
    for name, some in cases.items():
        z = whitened(some)
        cells = [
            f"{share_at_end(z[part]):.0%} / {_percent(share_of_mean(z[part]))} / {share_above(z[part]):.0%}"
            if part in z
            else "-"
            for part in PARTS
        ]
        rows.append([name, *cells])
    return ["end / mean / too large", *PARTS], rows


def ratio_table(cases: Mapping[str, Sequence[Result]]) -> tuple[list[str], list[list[str]]]:
    """Head and one row a case."""
    parts = ("horizontal", "heading", "up")
    rows = []
    for name, some in cases.items():
        z = whitened(some)
        ratios = [f"{np.sqrt(np.mean(z[part] ** 2)):.2f}" if part in z else "-" for part in parts]
        ends = [
            f"{np.mean((z[part][:, -1] ** 2).sum(axis=1)) / PARTS[part]:.2f}" if part in z else "-"
            for part in ("pose", "position", "heading")
        ]
        rows.append([name, *ratios, *ends])
    return ["case", *parts, "NEES / n, pose", "position", "heading"], rows


def judged(name: str, some: Sequence[Result]) -> list[Figure]:
    """What is asked of the smoother; of other methods nothing."""
    z = whitened(some)
    key = some[0].key
    parts = ("pose",) if "pose" in z else ("position", "heading")
    if not all(part in z for part in parts):
        end = mean = -math.inf
    else:
        end, mean = (min(share(z[part]) for part in parts) for share in (share_at_end, share_of_mean))
    # A walk that failed is one outside.
    solved = sum(not result.failed for result in some) / len(some)
    low = LEAST_SHARE if key.method == "smoother" else -math.inf
    words = " and ".join(parts)
    figures = [Figure(name, f"{words}, at the end", key.method, end * solved, low, pattern="{:.2f}")]
    mean_asked = Figure(name, f"{words}, mean over {len(PLACES)}", key.method, mean * solved, low, pattern="{:.2f}")
    return figures if math.isnan(mean) else [*figures, mean_asked]


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{share:.0%}"


if __name__ == "__main__":
    harness.run(main)
