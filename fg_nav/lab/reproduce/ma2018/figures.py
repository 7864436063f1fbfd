"""Ma's Figures 3, 6, 7, 8 and 11: the field in a building, the calibration, the ROC, and headings of the office.

Ma's Figures 9, 10 and 12 to 16: the office and the mall, of the first seed, a panel for each field.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes

from fg_nav.arrays import Bools, Floats
from fg_nav.lab import palette
from fg_nav.lab.reproduce import drawing
from fg_nav.lab.reproduce.drawing import Pictures
from fg_nav.lab.reproduce.ma2018 import walks as tables
from fg_nav.lab.reproduce.ma2018.detections import LIMIT_UT, MA, MA_THRESHOLD, OURS, Case
from fg_nav.lab.reproduce.ma2018.loop import CLSEF, MA_B_UT, MA_K, MG_PER_UT, Loop
from fg_nav.lab.reproduce.ma2018.magnetometer import FIELD
from fg_nav.lab.reproduce.results import Picture
from fg_nav.lab.reproduce.walks import Walks
from fg_nav.lab.roc import Roc
from fg_nav.lab.store.results import Arrays, Result
from fg_nav.lab.walked import AS_STARTED
from fg_nav.report.plots import style


def figure_3(pictures: Pictures, walks: Mapping[str, Arrays]) -> Picture:
    """Strength along the office, by field."""
    with style.styled():
        figure, [axes] = drawing.new_panels(1, 1, 3.2)
        for (field, walk), colour in zip(walks.items(), palette.CYCLE, strict=False):
            axes.plot(walk["strength_t"], MG_PER_UT * walk["strength"], color=colour, linewidth=0.6, label=field)
        axes.set(xlabel="time (s)", ylabel="magnitude (mG)")
        axes.margins(x=0.01)
        style.head(axes, "Magnitude of the magnetic field indoors")
    what = "magnitude of the field in a building"
    return pictures.keep(figure, 3, what, "the walk through the office, swing and stance")


_PLANES = (("a", 0, 2), ("b", 0, 1), ("c", 1, 2))


def figure_6(pictures: Pictures, loop: Loop) -> Picture:
    """Readings of the tumbled module in three planes, before and after CLSEF."""
    raw = loop.tumbled[np.isfinite(loop.tumbled).all(axis=1)]
    K = loop.K * np.cbrt(np.linalg.det(MA_K) / np.linalg.det(loop.K))
    corrected = (raw - loop.B_uT) @ K.T
    with style.styled():
        figure, panels = drawing.new_panels(1, 3, 3.5, 9.0)
        for axes, (letter, i, j) in zip(panels, _PLANES, strict=True):
            for readings, colour, label in ((raw, palette.VERMILION, "raw"), (corrected, palette.BLUE, "corrected")):
                axes.plot(*MG_PER_UT * readings[:, (i, j)].T, ".", color=colour, markersize=1.5, label=label)
            axes.set(xlabel=f"{'XYZ'[i]} (mG)", ylabel=f"{'XYZ'[j]} (mG)")
            axes.set_aspect("equal", adjustable="datalim")
            axes.set_title(f"({letter}) {'XYZ'[i]}-{'XYZ'[j]} plane")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, markerscale=6.0)
    shift = ", ".join(f"{MG_PER_UT * value:.0f}" for value in MA_B_UT)
    ours = f"the module without the shoe, tumbled for a minute, with the iron of Table 1 (B_c {shift} mG)"
    what = "field measured while the module is rotated, in the planes X-Z, X-Y and Y-Z"
    return pictures.keep(figure, 6, what, ours)


_COMPARED = {"CLSEF": CLSEF, "proposed, as printed": "ellipse, as printed", "proposed, fitted": "ellipse, fitted"}


def figure_7(pictures: Pictures, loop: Loop) -> Picture:
    """Magnetic less gyro heading of each calibration along the loop."""
    with style.styled():
        figure, [axes] = drawing.new_panels(1, 1, 3.4)
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
        figure, [axes] = drawing.new_panels(1, 1, 4.6, 5.6)
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
        f"the detector {tables.PRINTED} on the mall in three fields, and with what counts as a change there",
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
        figure, panels = drawing.new_panels(len(walks), 1, 2.9 * len(walks) + 0.3)
        for axes, (field, walk) in zip(panels, walks.items(), strict=True):
            draw_headings(axes, walk, walk["t"] <= first_loop_s(walk), f"{field}: headings of the first loop")
        panels[-1].set_xlabel("time (s)")
    return pictures.keep(
        figure,
        11,
        "headings of the first loop of the office, proposed method",
        "by compass, gyroscope and the filter as printed; dots: footfalls whose field it accepts",
    )


def draw_headings(axes: Axes, walk: Arrays, part: Bools, title: str) -> None:
    """Draw the headings of those footfalls; the compass broken where it turns by more than half a round."""
    t = walk["t"][part]
    compass, gyroscope, estimate = (_near(walk[name][part], walk["gyroscope"][part]) for name in _HEADINGS)
    axes.plot(t, compass, color=palette.ORANGE, linewidth=0.8, label="compass")
    axes.plot(t, gyroscope, color=style.INK, linewidth=1.2, label="gyroscope")
    axes.plot(t, estimate, color=palette.BLUE, linewidth=1.2, label="filter")
    used = walk["used"][part]
    axes.plot(t[used], compass[used], "o", color=palette.VERMILION, markersize=2.8, label="accepted", zorder=5)
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


DRAWN = {name: name + tables.PRESET[tables.PRINTED] for name in (tables.ZUPT, tables.IQSF, tables.PROPOSED)}
"""The paper's three methods, as they are drawn: as printed."""


def first(walks: Walks, scenario: str, field: str, method: str) -> Result | None:
    """Result of the first walk that did not fail."""
    return next((result for result in walks.of(scenario, field, method) if not result.failed), None)


def figure_9(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> Picture:
    """The true way through the office, from above."""
    with style.styled():
        figure, [axes] = drawing.new_panels(1, 1, 3.6)
        result = first(walks, tables.OFFICE, fields[0], DRAWN[tables.ZUPT])
        if result is not None:
            drawing.draw_path(axes, drawing.truth_of(result), "truth", style.INK)
        axes.set_title("The office from above: three loops on the same way")
    what = "bird's eye view of the office (a photograph)"
    return pictures.keep(figure, 9, what, "the true way of the simulated walk")


def figure_10(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> Picture:
    """Trajectories of the three methods in the office."""
    with style.styled():
        figure, panels = drawing.new_panels(len(fields), 3, 3.0 * len(fields) + 0.3, 10.0)
        for k, field in enumerate(fields):
            for axes, (name, method), letter in zip(panels[3 * k :], DRAWN.items(), "abc", strict=False):
                _draw(axes, first(walks, tables.OFFICE, field, method), tables.NAMES[name], palette.BLUE)
                axes.set_title(f"({letter}) {tables.NAMES[name]}, {field}")
    return pictures.keep(
        figure,
        10,
        "trajectories of the office test: (a) pure ZUPT, (b) iQSF, (c) proposed",
        "the filters as printed, as started, over the truth (grey); squares: ends",
    )


def figure_12(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> Picture:
    """Trajectories of the three methods in the mall."""
    with style.styled():
        figure, panels = drawing.new_panels(1, len(fields), 5.2, 4.8 * len(fields) + 0.4)
        for axes, field in zip(panels, fields, strict=True):
            colours = (palette.ORANGE, palette.VERMILION, palette.BLUE)
            for (name, method), colour in zip(DRAWN.items(), colours, strict=True):
                _draw(
                    axes,
                    first(walks, tables.MALL, field, method),
                    tables.NAMES[name],
                    colour,
                    with_truth=name == tables.ZUPT,
                )
            style.head(axes, f"The mall, field {field}", columns=2)
    return pictures.keep(
        figure, 12, "trajectories obtained by pure ZUPT, iQSF and the proposed method", "the filters as printed"
    )


def _draw(axes: Axes, result: Result | None, label: str, colour: str, with_truth: bool = True) -> None:
    if result is not None:
        drawing.draw_path(
            axes, drawing.estimate_of(result), label, colour, drawing.truth_of(result) if with_truth else None
        )


def figures_13_14(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> list[Picture]:
    """Where each detector accepts the field of the mall."""
    kept = []
    for number, name in ((13, tables.IQSF), (14, tables.PROPOSED)):
        with style.styled():
            figure, panels = drawing.new_panels(len(fields), 1, 1.6 * len(fields) + 0.4)
            for axes, field in zip(panels, fields, strict=True):
                result = first(walks, tables.MALL, field, DRAWN[name])
                if result is not None:
                    drawing.draw_flags(axes, drawing.used_of(result), f"{tables.NAMES[name]}, {field}")
            panels[-1].set_xlabel("stride")
        what = f"detection of the quasi-static field, {tables.NAMES[name]}"
        kept.append(pictures.keep(figure, number, what, "the detector as printed along the mall; 1 is quasi-static"))
    return kept


def figures_15_16(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> list[Picture]:
    """Errors at the 42 crossings of landmarks."""
    return [
        _landmarks(pictures, walks, fields, number, name) for number, name in ((15, tables.IQSF), (16, tables.PROPOSED))
    ]


def _landmarks(pictures: Pictures, walks: Walks, fields: Sequence[str], number: int, name: str) -> Picture:
    methods = {
        f"{tables.NAMES[name]}, {tables.PRINTED}": DRAWN[name],
        tables.TUNED: name,
        tables.SMOOTHER: tables.SMOOTHER,
    }
    with style.styled():
        figure, panels = drawing.new_panels(len(fields), 1, 2.6 * len(fields) + 0.4)
        for axes, field in zip(panels, fields, strict=True):
            found = {label: first(walks, tables.MALL, field, method) for label, method in methods.items()}
            errors = _errors({label: result for label, result in found.items() if result is not None})
            names = next((result.landmark for result in found.values() if result is not None), ())
            drawing.draw_landmarks(axes, names, errors, f"field {field}")
        panels[-1].set_xlabel("landmark, in the order of the walk")
    what = f"positioning errors of the {tables.NAMES[name]} method at the landmarks"
    return pictures.keep(figure, number, what, "42 crossings of 14 landmarks; bars: the filter as printed")


def _errors(results: Mapping[str, Result]) -> dict[str, Sequence[float]]:
    return {label: result.landmark_m[AS_STARTED] for label, result in results.items()}
