"""Ma's Figures 9, 10 and 12 to 16: the office and the mall, of the first seed, a panel for each field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes

from fg_nav.evaluation.walked import AS_STARTED
from fg_nav.lab.campaign.kept import Result
from fg_nav.lab.reproduce.cells import Walks
from fg_nav.lab.reproduce.drawing import (
    Pictures,
    draw_flags,
    draw_landmarks,
    draw_path,
    estimate_of,
    new_panels,
    truth_of,
    used_of,
)
from fg_nav.lab.reproduce.ma2018_walks import (
    IQSF,
    MALL,
    NAMES,
    OFFICE,
    PRESET,
    PRINTED,
    PROPOSED,
    SMOOTHER,
    TUNED,
    ZUPT,
)
from fg_nav.lab.reproduce.results import Picture
from fg_nav.report import style

DRAWN = {name: name + PRESET[PRINTED] for name in (ZUPT, IQSF, PROPOSED)}
"""The paper's three methods, as they are drawn: as printed."""


def first(walks: Walks, scenario: str, field: str, method: str) -> Result | None:
    """Result of the first walk that did not fail."""
    return next((result for result in walks.of(scenario, field, method) if not result.failed), None)


def figure_9(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> Picture:
    """The true way through the office, from above."""
    with style.styled():
        figure, [axes] = new_panels(1, 1, 3.6)
        result = first(walks, OFFICE, fields[0], DRAWN[ZUPT])
        if result is not None:
            draw_path(axes, truth_of(result), "truth", style.INK)
        axes.set_title("The office from above: three loops on the same way")
    return pictures.keep(
        figure, 9, "bird's eye view of the office (a photograph)", "the true way of the simulated walk"
    )


def figure_10(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> Picture:
    """Trajectories of the three methods in the office."""
    with style.styled():
        figure, panels = new_panels(len(fields), 3, 3.0 * len(fields) + 0.3, 10.0)
        for k, field in enumerate(fields):
            for axes, (name, method), letter in zip(panels[3 * k :], DRAWN.items(), "abc", strict=False):
                _draw(axes, first(walks, OFFICE, field, method), NAMES[name], style.BLUE)
                axes.set_title(f"({letter}) {NAMES[name]}, {field}")
    return pictures.keep(
        figure,
        10,
        "trajectories of the office test: (a) pure ZUPT, (b) iQSF, (c) proposed",
        "the filters as printed, as started, over the truth (grey); squares: ends",
    )


def figure_12(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> Picture:
    """Trajectories of the three methods in the mall."""
    with style.styled():
        figure, panels = new_panels(1, len(fields), 5.2, 4.8 * len(fields) + 0.4)
        for axes, field in zip(panels, fields, strict=True):
            colours = (style.ORANGE, style.VERMILION, style.BLUE)
            for (name, method), colour in zip(DRAWN.items(), colours, strict=True):
                _draw(axes, first(walks, MALL, field, method), NAMES[name], colour, with_truth=name == ZUPT)
            style.head(axes, f"The mall, field {field}", columns=2)
    return pictures.keep(
        figure, 12, "trajectories obtained by pure ZUPT, iQSF and the proposed method", "the filters as printed"
    )


def _draw(axes: Axes, result: Result | None, label: str, colour: str, with_truth: bool = True) -> None:
    if result is not None:
        draw_path(axes, estimate_of(result), label, colour, truth_of(result) if with_truth else None)


def figures_13_14(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> list[Picture]:
    """Where each detector believes the field of the mall."""
    kept = []
    for number, name in ((13, IQSF), (14, PROPOSED)):
        with style.styled():
            figure, panels = new_panels(len(fields), 1, 1.6 * len(fields) + 0.4)
            for axes, field in zip(panels, fields, strict=True):
                result = first(walks, MALL, field, DRAWN[name])
                if result is not None:
                    draw_flags(axes, used_of(result), f"{NAMES[name]}, {field}")
            panels[-1].set_xlabel("stride")
        what = f"detection of the quasi-static field, {NAMES[name]}"
        kept.append(pictures.keep(figure, number, what, "the detector as printed along the mall; 1 is quasi-static"))
    return kept


def figures_15_16(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> list[Picture]:
    """Errors at the 42 crossings of landmarks."""
    return [_landmarks(pictures, walks, fields, number, name) for number, name in ((15, IQSF), (16, PROPOSED))]


def _landmarks(pictures: Pictures, walks: Walks, fields: Sequence[str], number: int, name: str) -> Picture:
    methods = {f"{NAMES[name]}, {PRINTED}": DRAWN[name], TUNED: name, SMOOTHER: SMOOTHER}
    with style.styled():
        figure, panels = new_panels(len(fields), 1, 2.6 * len(fields) + 0.4)
        for axes, field in zip(panels, fields, strict=True):
            found = {label: first(walks, MALL, field, method) for label, method in methods.items()}
            errors = _errors({label: result for label, result in found.items() if result is not None})
            names = next((result.landmark for result in found.values() if result is not None), ())
            draw_landmarks(axes, names, errors, f"field {field}")
        panels[-1].set_xlabel("landmark, in the order of the walk")
    return pictures.keep(
        figure,
        number,
        f"positioning errors of the {NAMES[name]} method at the landmarks",
        "42 crossings of 14 landmarks; bars: the filter as printed",
    )


def _errors(results: Mapping[str, Result]) -> dict[str, Sequence[float]]:
    return {label: result.landmark_m[AS_STARTED] for label, result in results.items()}
