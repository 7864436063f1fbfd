"""Ma's Figures 3, 6, 7, 8 and 11: the field in a building, the calibration, the ROC, and headings of the office."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from fg_nav.arrays import Bools, Floats
from fg_nav.evaluation import Roc
from fg_nav.lab.reproduce.drawing import Pictures, new_panels
from fg_nav.lab.reproduce.ma2018_detector import FIELD, PRINTED
from fg_nav.lab.reproduce.ma2018_loop import CLSEF, MA_B_UT, MA_K, MG_PER_UT, Loop
from fg_nav.lab.reproduce.ma2018_roc import LIMIT_UT, MA, MA_THRESHOLD, OURS, Case
from fg_nav.lab.reproduce.parts import Arrays
from fg_nav.lab.reproduce.results import Picture
from fg_nav.report import style


def figure_3(pictures: Pictures, walks: Mapping[str, Arrays]) -> Picture:
    """Strength along the office, by field."""
    with style.styled():
        figure, [axes] = new_panels(1, 1, 3.2)
        for (field, walk), colour in zip(walks.items(), style.CYCLE, strict=False):
            axes.plot(walk["strength_t"], MG_PER_UT * walk["strength"], color=colour, linewidth=0.6, label=field)
        axes.set(xlabel="time (s)", ylabel="magnitude (mG)")
        axes.margins(x=0.01)
        style.head(axes, "Magnitude of the magnetic field indoors")
    return pictures.keep(
        figure, 3, "magnitude of the field in a building", "the walk through the office, swing and stance"
    )


_PLANES = (("a", 0, 2), ("b", 0, 1), ("c", 1, 2))


def figure_6(pictures: Pictures, loop: Loop) -> Picture:
    """Readings of the tumbled module in three planes, before and after CLSEF."""
    raw = loop.tumbled[np.isfinite(loop.tumbled).all(axis=1)]
    K = loop.K * np.cbrt(np.linalg.det(MA_K) / np.linalg.det(loop.K))
    corrected = (raw - loop.B_uT) @ K.T
    with style.styled():
        figure, panels = new_panels(1, 3, 3.5, 9.0)
        for axes, (letter, i, j) in zip(panels, _PLANES, strict=True):
            for readings, colour, label in ((raw, style.VERMILION, "raw"), (corrected, style.BLUE, "corrected")):
                axes.plot(*MG_PER_UT * readings[:, (i, j)].T, ".", color=colour, markersize=1.5, label=label)
            axes.set(xlabel=f"{'XYZ'[i]} (mG)", ylabel=f"{'XYZ'[j]} (mG)")
            axes.set_aspect("equal", adjustable="datalim")
            axes.set_title(f"({letter}) {'XYZ'[i]}-{'XYZ'[j]} plane")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, markerscale=6.0)
    shift = ", ".join(f"{MG_PER_UT * value:.0f}" for value in MA_B_UT)
    return pictures.keep(
        figure,
        6,
        "field measured while the module is rotated, in the planes X-Z, X-Y and Y-Z",
        f"the module without the shoe, tumbled for a minute, with the iron of Table 1 (B_c {shift} mG)",
    )


_COMPARED = {"CLSEF": CLSEF, "proposed, as printed": "ellipse, as printed", "proposed, fitted": "ellipse, fitted"}


def figure_7(pictures: Pictures, loop: Loop) -> Picture:
    """Magnetic less gyro heading of each calibration along the loop."""
    with style.styled():
        figure, [axes] = new_panels(1, 1, 3.4)
        axes.axhspan(-5.0, 5.0, color=style.SHADE, zorder=0)
        for (label, method), colour in zip(_COMPARED.items(), style.CYCLE[1::-1] + style.CYCLE[2:], strict=False):
            axes.plot(np.degrees(loop.heading[method]), ".-", color=colour, linewidth=0.8, markersize=3.0, label=label)
        axes.set(xlabel="footfall", ylabel="heading difference (deg)")
        axes.margins(x=0.01)
        style.head(axes, "Heading by the calibrated magnetometer less heading by the gyroscope")
    return pictures.keep(
        figure,
        7,
        "heading after calibration by CLSEF and by the proposed method",
        "the calibration loop; shaded: the 5 deg that the paper names",
    )


def figure_8(pictures: Pictures, cases: Mapping[str, Case]) -> Picture:
    """ROC of the proposed detector, with 170 marked."""
    with style.styled():
        figure, [axes] = new_panels(1, 1, 4.6, 5.6)
        for (field, case), colour in zip(cases.items(), style.CYCLE, strict=False):
            _draw_roc(axes, case.roc(MA), f"{field}, {LIMIT_UT[field]:g} uT", colour, "-")
        _draw_roc(axes, cases[FIELD].roc(OURS), f"{FIELD}, physical", style.CYCLE[1], (0, (4, 2)))
        axes.plot([0, 1], [0, 1], color=style.SOFT_INK, linewidth=0.8, linestyle=(0, (2, 3)))
        axes.set(xlim=(-0.01, 1.01), ylim=(-0.01, 1.01), xlabel="probability of false alarm")
        axes.set(ylabel="probability of detection", box_aspect=1)
        style.head(axes, f"ROC, N = 3; dots: threshold {MA_THRESHOLD:g}", columns=2)
    return pictures.keep(
        figure,
        8,
        "ROC of the proposed detector, N = 3",
        f"the detector {PRINTED} on the mall in three fields, and with what counts as a change there",
    )


def _draw_roc(axes: Axes, roc: Roc | None, label: str, colour: str, dash: str | tuple[int, tuple[int, int]]) -> None:
    if roc is None:
        return
    axes.plot(roc.p_fa, roc.p_d, color=colour, linestyle=dash, label=label)
    if dash == "-":
        p_d, p_fa = roc.at(1.0)
        axes.plot(p_fa, p_d, "o", color=colour, markersize=6.0, zorder=5, clip_on=False)


def figure_11(pictures: Pictures, walks: Mapping[str, Arrays]) -> Picture:
    """Headings of the office's first loop, by field."""
    with style.styled():
        figure, panels = new_panels(len(walks), 1, 2.9 * len(walks) + 0.3)
        for axes, (field, walk) in zip(panels, walks.items(), strict=True):
            draw_headings(axes, walk, walk["t"] <= first_loop_s(walk), f"{field}: headings of the first loop")
        panels[-1].set_xlabel("time (s)")
    return pictures.keep(
        figure,
        11,
        "headings of the first loop of the office, proposed method",
        "by compass, gyroscope and the filter as printed; dots: footfalls whose field it believes",
    )


def draw_headings(axes: Axes, walk: Arrays, part: Bools, title: str) -> None:
    """Draw the headings of those footfalls; the compass broken where it turns by more than half a round."""
    t = walk["t"][part]
    compass, gyroscope, estimate = (_near(walk[name][part], walk["gyroscope"][part]) for name in _HEADINGS)
    axes.plot(t, compass, color=style.ORANGE, linewidth=0.8, label="compass")
    axes.plot(t, gyroscope, color=style.INK, linewidth=1.2, label="gyroscope")
    axes.plot(t, estimate, color=style.BLUE, linewidth=1.2, label="filter")
    used = walk["used"][part]
    axes.plot(t[used], compass[used], "o", color=style.VERMILION, markersize=2.8, label="believed", zorder=5)
    axes.set_ylabel("heading (deg)")
    axes.margins(x=0.01)
    style.head(axes, title)


_HEADINGS = ("compass", "gyroscope", "estimate")


def _near(heading: Floats, reference: Floats) -> Floats:
    """In deg without jumps: each within half a round of the reference, and that unwrapped."""
    smooth = np.unwrap(reference)
    return np.asarray(np.degrees(smooth + np.angle(np.exp(1j * (heading - smooth)))))


def first_loop_s(walk: Arrays) -> float:
    """When a third of the way is walked."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(walk["place"], axis=0), axis=1))])
    return float(walk["t"][np.searchsorted(way, way[-1] / 3.0)])
