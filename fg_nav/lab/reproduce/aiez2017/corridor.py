"""Z-E1: a magnet on the floor of a corridor, as the classical and the proposed detector see it (Zhang, Figures 5, 6).

The paper shows one drawing and gives no number: the classical detector believes the field beside the magnet, the
proposed one does not. As bounds: at least 80 % of the footfalls beside the magnet believed, and at most 20 %.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from fg_nav.lab.reproduce.aiez2017.magnet import FAR, NEAR, STRONGER, Judged, pooled, told_apart
from fg_nav.lab.reproduce.results import ABOVE, Experiment, Picture, Reason, Row, Spread, one_line, reason_for

CLASSICAL, PRINTED, PHYSICAL = "classical", "as printed", "physical"

DETECTOR_OF = {CLASSICAL: "qsf-stance", PRINTED: "aiez-printed", PHYSICAL: "aiez"}

BELIEVED, REJECTED = 0.8, 0.2
"""Shares that stand for the paper's "accepts" and "rejects"."""

STRENGTHS = (1, STRONGER)

_SETTING = """Scenario magnet-corridor: to and fro past a magnet on the floor, MTw in the heel, 100 Hz, magnetometer
calibrated. The paper describes no magnet: ours is a block of 3 cm3 of neodymium, which turns the field at hardly any
footfall by 10 deg, and so it is laid there ten times over as well. Near: footfalls at which the magnet turns the field
by more than 10 deg; far: by less than 2. Shares are of the footfalls of all walks, in brackets 5 to 95 % of single
walks; "believed" is held to 0.8 at least, "rejected" to 0.2 at most. Classical: the rate of the strength within a
stance, which lets pass nearly every footfall, far or near (rows): it is no gate at all. As printed: AIEZ (17) with
10 deg and 0.5 uT/s, for no sigma is printed; physical: the same channels with 2.5 deg beside the drift of the
gyroscope."""

_SIGMA = """No sigma, window or threshold is printed. With 10 deg for the compass and the 99 % quantile the test rejects
what is some 30 deg off, and the magnet turns the field of many of these footfalls by less; with 2.5 deg it rejects
nearly all (column beside)."""

_FEW = "One magnet turns the field that far at a few footfalls of all walks only (row)."


def corridor_experiment(walks: Mapping[int, Sequence[Judged]], pictures: Sequence[Picture]) -> Experiment:
    """Shares believed, by the strength of the magnet."""
    rows = [row for strength, some in walks.items() for row in _rows(strength, some)]
    title = "A magnet on the floor of a corridor (Figures 5 and 6)"
    return Experiment("Z-E1", title, one_line(_SETTING), tuple(DETECTOR_OF), rows, pictures)


def _rows(strength: int, walks: Sequence[Judged]) -> Iterator[Row]:
    where = "one magnet" if strength == 1 else "ten magnets"
    few = f" {_FEW}" if strength == 1 else ""
    near, far = (_each(partial(_share, walks, zone)) for zone in (NEAR, FAR))
    classical = {CLASSICAL: near[CLASSICAL]} if CLASSICAL in near else {}
    proposed = {column: spread for column, spread in near.items() if column != CLASSICAL}
    yield Row(f"footfalls near, all walks, {where}", "", "", _each(partial(_number, walks)), pattern="{:.0f}")
    yield Row(
        f"near believed, classical QMD, {where}",
        "",
        "believed",
        classical,
        BELIEVED,
        CLASSICAL,
        bound=-1,
        good=1,
    )
    yield Row(
        f"near believed, proposed, {where}",
        "",
        "rejected",
        proposed,
        REJECTED,
        PRINTED,
        bound=1,
        why=_why_believed(proposed, few),
    )
    yield Row(f"far believed, {where}", "", "", far)
    yield Row(f"near told from far (area under the ROC), {where}", "", "", _each(partial(_area, walks)))


def _why_believed(proposed: Mapping[str, Spread], few: str) -> str:
    off = proposed[PRINTED].median - REJECTED if PRINTED in proposed else 0.0
    return reason_for((Reason(_SIGMA + few, ABOVE),), "", off)


def _each(figure: Callable[[str], Spread]) -> dict[str, Spread]:
    """By column; left out where no footfall tells."""
    found = {column: figure(detector) for column, detector in DETECTOR_OF.items()}
    return {column: spread for column, spread in found.items() if spread.n}


def _number(walks: Sequence[Judged], name: str) -> Spread:
    """Of the footfalls near, of all walks."""
    number = float(len(pooled(walks, name, NEAR)))
    return Spread(number, number, number, len(walks))


def _share(walks: Sequence[Judged], zone: tuple[float, float], name: str) -> Spread:
    together = pooled(walks, name, zone)
    each = [float((part < 1.0).mean()) for walk in walks if len(part := walk.between(name, *zone))]
    if not each:
        return Spread(np.nan, np.nan, np.nan, 0)
    low, high = np.percentile(each, [5.0, 95.0])
    return Spread(float((together < 1.0).mean()), float(low), float(high), len(each))


def _area(walks: Sequence[Judged], name: str) -> Spread:
    """Of all footfalls together."""
    area = told_apart(walks, name)
    return Spread(area, area, area, len(walks) if np.isfinite(area) else 0)
