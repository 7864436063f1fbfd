"""Z-E1: a magnet on the floor of a corridor, as the classical and the proposed detector see it (Zhang, Figures 5, 6).

A foot that stands beside a magnet stands in a field that is wrong and does not change. The classical detector tests the
rate of the strength within a stance (`qsf-stance`) and accepts it; AIEZ compares compass and inertial heading.

The paper shows one drawing and no number: the classical detector accepts the field beside the magnet, the proposed one
does not. As bounds: at least 80 % of the footfalls beside the magnet accepted, and at most 20 %. `measure_separation`
is what a detector could do at best, whatever its threshold; 0.5 is a coin.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes

from fg_nav.arrays import Bools, Floats
from fg_nav.lab import palette
from fg_nav.lab.reproduce.aiez2017.magnet import FAR, NEAR, STRONGER, Judged, measure_separation, pool
from fg_nav.lab.reproduce.drawing import Pictures, new_panels
from fg_nav.lab.reproduce.results import ABOVE, Experiment, Picture, Reason, Row, Spread, one_line, reason_for
from fg_nav.lab.store.results import Arrays
from fg_nav.report.plots import style

CLASSICAL, PRINTED, PHYSICAL = "classical", "as printed", "physical"

DETECTOR_OF = {CLASSICAL: "qsf-stance", PRINTED: "aiez-printed", PHYSICAL: "aiez"}

ACCEPTED, REJECTED = 0.8, 0.2  # Shares that stand for the paper's "accepts" and "rejects".

STRENGTHS = (1, STRONGER)

_SETTING = """Scenario magnet-corridor: to and fro past a magnet on the floor, MTw in the heel, 100 Hz, magnetometer
calibrated. The paper describes no magnet: ours is a block of 3 cm3 of neodymium, which turns the field at hardly any
footfall by 10 deg, and so it is laid there ten times over as well. Near: footfalls at which the magnet turns the field
by more than 10 deg; far: by less than 2. Shares are of the footfalls of all walks, in brackets 5 to 95 % of single
walks; "accepted" is held to 0.8 at least, "rejected" to 0.2 at most. Classical: the rate of the strength within a
stance, which lets pass nearly every footfall, far or near (rows): it is no gate at all. As printed: AIEZ (17) with
10 deg and 0.5 uT/s, for no sigma is printed; physical: the same channels with 2.5 deg beside the drift of the
gyroscope."""

_SIGMA = """No sigma, window or threshold is printed. With 10 deg for the compass and the 99 % quantile the test rejects
what is some 30 deg off, and the magnet turns the field of many of these footfalls by less; with 2.5 deg it rejects
nearly all (column beside)."""

_FEW = "One magnet turns the field that far at a few footfalls of all walks only (row)."


def corridor_experiment(walks: Mapping[int, Sequence[Judged]], pictures: Sequence[Picture]) -> Experiment:
    """Shares accepted, by the strength of the magnet."""
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
    name = f"near accepted, classical QMD, {where}"
    yield Row(name, "", "accepted", classical, ACCEPTED, CLASSICAL, bound=-1, good=1)
    off = proposed[PRINTED].median - REJECTED if PRINTED in proposed else 0.0
    why = reason_for((Reason(_SIGMA + few, ABOVE),), "", off)
    yield Row(f"near accepted, proposed, {where}", "", "rejected", proposed, REJECTED, PRINTED, bound=1, why=why)
    yield Row(f"far accepted, {where}", "", "", far)
    yield Row(f"near distinguished from far (area under the ROC), {where}", "", "", _each(partial(_area, walks)))


def _each(figure: Callable[[str], Spread]) -> dict[str, Spread]:
    """By column; left out where there is no footfall."""
    found = {column: figure(detector) for column, detector in DETECTOR_OF.items()}
    return {column: spread for column, spread in found.items() if spread.n}


def _number(walks: Sequence[Judged], name: str) -> Spread:
    """Of the footfalls near, of all walks."""
    number = float(len(pool(walks, name, NEAR)))
    return Spread(number, number, number, len(walks))


def _share(walks: Sequence[Judged], zone: tuple[float, float], name: str) -> Spread:
    together = pool(walks, name, zone)
    each = [float((part < 1.0).mean()) for walk in walks if len(part := walk.between(name, *zone))]
    if not each:
        return Spread(np.nan, np.nan, np.nan, 0)
    low, high = np.percentile(each, [5.0, 95.0])
    return Spread(float((together < 1.0).mean()), float(low), float(high), len(each))


def _area(walks: Sequence[Judged], name: str) -> Spread:
    """Of all footfalls together."""
    area = measure_separation(walks, name)
    return Spread(area, area, area, len(walks) if np.isfinite(area) else 0)


ZOOM_S = 8.0  # Before and after the footfall that the magnet turns most.


def figure_5(pictures: Pictures, walk: Arrays) -> Picture:
    """The corridor from above: footfalls, and where the magnet lies."""
    near = walk["turned_deg"] > NEAR[0]
    with style.styled():
        figure, [axes] = new_panels(1, 1, 2.6)
        for places, mark, colour, size, label in (
            (walk["place"], ".", palette.TRUTH, 4.0, "footfalls"),
            (walk["place"][near], "o", palette.VERMILION, 5.0, "turned by over 10 deg"),
            (walk["magnet"][None, :2], "s", style.INK, 7.0, "magnet"),
        ):
            axes.plot(places[:, 1], places[:, 0], mark, color=colour, markersize=size, label=label)
        axes.set(xlabel="along the corridor, north (m)", ylabel="across, east (m)", ylim=(1.5, -1.5))
        style.head(axes, "The corridor with the magnet on the floor, from above")
    what = "walking past a magnet on the floor (a photograph)"
    return pictures.keep(figure, 5, what, "the simulated corridor, ten magnets in one place")


_DRAWN = {
    "classical QMD": CLASSICAL,
    "proposed, as printed": PRINTED,
    "proposed, with the sigmas of physics": PHYSICAL,
}


def figure_6(pictures: Pictures, walk: Arrays) -> Picture:
    """Headings by compass and gyroscope, and what each detector accepts; to the right the magnet from close by."""
    whole = np.ones(len(walk["t"]), dtype=bool)
    worst = walk["t"][np.nanargmax(walk["turned_deg"])]
    close = np.abs(walk["t"] - worst) < ZOOM_S
    with style.styled():
        figure, panels = new_panels(len(_DRAWN), 2, 3.0 * len(_DRAWN), 10.0)
        for row, (words, column) in enumerate(_DRAWN.items()):
            accepted = walk[f"statistic {DETECTOR_OF[column]}"] < 1.0
            for part, axes in zip((whole, close), panels[2 * row :], strict=False):
                _draw_verdicts(axes, walk, part, accepted)
            style.head(panels[2 * row], words, columns=2)
            panels[2 * row + 1].set_title("beside the magnet")
        for axes in panels[-2:]:
            axes.set_xlabel("time (s)")
    return pictures.keep(
        figure,
        6,
        "detection by classical QMD and by the proposed method beside the magnet",
        "past ten magnets in one place; dots: accepted, red circles: turned by the magnet by more than 10 deg",
    )


def _draw_verdicts(axes: Axes, walk: Arrays, part: Bools, accepted: Bools) -> None:
    """Draw the headings of those footfalls, in deg about the gyroscope's, unwrapped."""
    t, smooth = walk["t"][part], np.unwrap(walk["gyroscope"])[part]
    compass: Floats = np.degrees(smooth + np.angle(np.exp(1j * (walk["compass"][part] - smooth))))
    near = (walk["turned_deg"] > NEAR[0])[part]
    axes.plot(t, np.degrees(smooth), color=style.INK, linewidth=1.2, label="INS heading")
    axes.plot(t, compass, color=palette.ORANGE, linewidth=0.9, label="magnetic heading")
    axes.plot(t[accepted[part]], compass[accepted[part]], "o", color=palette.BLUE, markersize=3.0, label="accepted")
    axes.plot(
        t[near], compass[near], "o", color="red", markersize=9.0, markerfacecolor="none", label="disturbed", zorder=5
    )
    axes.set_ylabel("heading (deg)")
    axes.margins(x=0.02)
