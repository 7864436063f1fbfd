"""Figures 7, 8, 10 and 12 of Ma et al. (2018)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes

from fg_nav.lab import palette
from fg_nav.lab.reproduce.drawing import Pictures, draw_paths, new_panels
from fg_nav.lab.reproduce.ma2018.detections import LIMIT_UT, MA, MA_THRESHOLD, OURS, Case
from fg_nav.lab.reproduce.ma2018.loop import CLSEF, Loop
from fg_nav.lab.reproduce.results import Picture
from fg_nav.lab.reproduce.runner import Made
from fg_nav.lab.roc import Roc
from fg_nav.report.plots import style

OFFICE, MALL, PRINTED = "office", "mall", "as printed"
NAMES = {"iez": "pure ZUPT", "iqsf": "iQSF", "ma2018": "proposed"}  # The paper's words for its filters.
FIELD = "between"  # The field in which there are stances of both kinds.


def draw_all(pictures: Pictures, made: Made, loop: Loop, cases: Mapping[str, Case]) -> dict[str, list[Picture]]:
    """Draw the figures of each experiment."""
    what, ours = "trajectories of pure ZUPT, iQSF and the proposed method", "the filters as printed; squares: ends"
    office, mall = (draw_paths(made, scenario, NAMES, f"The {scenario}") for scenario in (OFFICE, MALL))
    return {
        "M-E1": [figure_7(pictures, loop)],
        "M-E2b": [figure_8(pictures, cases)],
        "M-E3": [pictures.keep(office, 10, f"{what} in the office", ours)],
        "M-E4": [pictures.keep(mall, 12, f"{what} in the mall", ours)],
    }


_COMPARED = {"CLSEF": CLSEF, "proposed, as printed": "ellipse, as printed", "proposed, fitted": "ellipse, fitted"}


def figure_7(pictures: Pictures, loop: Loop) -> Picture:
    """Magnetic less gyro heading of each calibration along the loop."""
    with style.styled():
        figure, [axes] = new_panels(1, 1, 3.4)
        axes.axhspan(-5.0, 5.0, color="#DCE9F2", zorder=0)
        for (label, method), colour in zip(_COMPARED.items(), palette.CYCLE[1::-1] + palette.CYCLE[2:], strict=False):
            axes.plot(np.degrees(loop.heading[method]), ".-", color=colour, linewidth=0.8, markersize=3.0, label=label)
        axes.set(xlabel="footfall", ylabel="heading difference (deg)")
        axes.margins(x=0.01)
        style.head(axes, "Heading by the calibrated magnetometer less heading by the gyroscope")
    what = "heading after calibration by CLSEF and by the proposed method"
    return pictures.keep(figure, 7, what, "the calibration loop; shaded: the 5 deg that the paper names")


def figure_8(pictures: Pictures, cases: Mapping[str, Case]) -> Picture:
    """ROC of the proposed detector, with 170 marked."""
    with style.styled():
        figure, [axes] = new_panels(1, 1, 4.6, 5.6)
        for (field, case), colour in zip(cases.items(), palette.CYCLE, strict=False):
            _draw_roc(axes, case.roc(MA), f"{field}, {LIMIT_UT[field]:g} uT", colour, "-")
        _draw_roc(axes, cases[FIELD].roc(OURS), f"{FIELD}, physical", palette.CYCLE[1], (0, (4, 2)))
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
