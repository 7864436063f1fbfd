"""The experiments of Zhang et al. (AIEZ, 2017): Z-E1 the magnet on the floor (`corridor`), Z-E2 the teaching building.

Z-E2 is three cycles (Figure 7, Table I), each filter beside ours.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from fg_nav.lab import palette
from fg_nav.lab.campaign.walks import LOOP
from fg_nav.lab.reproduce import walks as read
from fg_nav.lab.reproduce.aiez2017.corridor import DETECTOR_OF, STRENGTHS, corridor_experiment, figure_5, figure_6
from fg_nav.lab.reproduce.aiez2017.magnet import SCENARIO, STRONGER, load_judged, magnet_part
from fg_nav.lab.reproduce.drawing import Pictures, draw_path, estimate_of, new_panels, truth_of
from fg_nav.lab.reproduce.results import (
    ABOVE,
    BELOW,
    Experiment,
    Picture,
    Reason,
    Reproduction,
    Row,
    Spread,
    one_line,
    reason_for,
)
from fg_nav.lab.reproduce.walks import Figure, Walks
from fg_nav.lab.store.results import Key
from fg_nav.report.plots import style

PAPER = "aiez2017"

CITATION = (
    "L. Zhang, K. Guo and Y. Liu: Pedestrian Dead Reckoning System using Quasi-static Magnetic Field Detection. 2017."
)

FIELDS = ("smooth", "indoor")

CORRIDORS = 20  # The first seeds of a run that are enough: of a quick one, and of walks past the magnet.


def reproduce(
    folder: Path,
    seeds: Sequence[int],
    workers: int = 2,
    progress: Callable[[float], None] | None = None,
    quick: bool = False,
) -> Reproduction:
    """Make all experiments, as `fg_nav.lab.reproduce.command.Paper`; what is stored in the folder is used.

    It leaves out nothing but seeds when `quick`.
    """
    corridors, wanted = seeds[:CORRIDORS], keys(FIELDS, seeds)
    parts = [magnet_part(strength, seed) for strength in STRENGTHS for seed in corridors]
    read.run_missing(folder, wanted, parts, workers, progress)
    walks, pictures = read.read_walks(folder, wanted), Pictures(folder, PAPER)
    past = {strength: load_judged(folder, strength, corridors) for strength in STRENGTHS}
    drawn = magnet_part(STRONGER, seeds[0]).load(folder)
    return Reproduction(
        paper=PAPER,
        citation=CITATION,
        seeds=tuple(seeds),
        experiments=[
            corridor_experiment(past, [figure_5(pictures, drawn), figure_6(pictures, drawn)]),
            building_experiment(walks, FIELDS, [figure_7(pictures, walks, FIELDS)]),
        ],
        differs=[one_line(text) for text in (*_DIFFERS, *read.describe_other_code(walks))],
        parameters=read.parameters_of(walks) | read.describe_walks([*wanted, _PAST_MAGNET], DETECTOR_OF.values()),
    )


_DIFFERS = (
    """The paper has one walk of each kind; ours are simulated, many times over, with a foot, a sensor and a building
    drawn again by each seed.""",
    """No window, sigma, threshold, Q, R or P0 is printed. The filter as printed has Zhang's equations with 10 deg and
    0.5 uT/s in the test and 5 deg for the compass, and OpenShoe's noise. What would break it is corrected and noted in
    each result: the sign of the compass, AIEZ (25), angles, AIEZ (20), (27), the axes of the errors of roll and pitch,
    AIEZ (22), (29).""",
    """Table I does not say what a position error is. Ours is that of the last footfall from the first, and as the walk
    ends where it began, it does not depend on how the path is laid on the truth.""",
    """The IEZ of the paper's one walk ends farther off than that of most of ours. So the gain of AIEZ over the IEZ is
    smaller here.""",
    """The classical detector has no printed threshold either. Ours, the rate of the strength within a stance, accepts
    the field beside the magnet, as the paper shows, but also everywhere else: IEZ + classical QMD is a filter with a
    compass at every footfall here, far better than in Table I and on the rough floor better than AIEZ as printed.""",
    """The smoother, and the matched filter both ways, are given the whole walk before they answer; the paper's filters
    answer at each step. The columns are no race between equals.""",
)


BUILDING = "teaching-building"
IEZ, CLASSICAL, AIEZ, SMOOTHER, INERTIAL = "iez", "qsf-stance", "aiez", "smoother", "inertial"

_PAST_MAGNET = Key(SCENARIO.name, FIELDS[0], "", LOOP, IEZ)
"""For the parameters of the scenario of Z-E1, whose walks are kept as parts."""

PRINTED, TUNED, BOTH_WAYS, NO_FIELD, OURS = "as printed", "tuned", "matched, both ways", "no field", "smoother"
COLUMNS = (PRINTED, TUNED, BOTH_WAYS, NO_FIELD, OURS)

PRESET = {PRINTED: ":as-printed", TUNED: ""}

MATCHED = "matched-rts"

METHODS = (
    *(IEZ + preset for preset in PRESET.values()),
    *(name + preset for name in (CLASSICAL, AIEZ) for preset in PRESET.values()),
    MATCHED,
    INERTIAL,
    SMOOTHER,
)

NAMES = {IEZ: "IEZ", CLASSICAL: "IEZ + classical QMD", AIEZ: "AIEZ"}

TABLE_1 = {IEZ: ("9.49", "1.84"), CLASSICAL: ("7.09", "1.38"), AIEZ: ("0.79", "0.15")}
"""Position error in m, and in percent of the way."""

_SETTING = """Scenario teaching-building: three cycles, 515.5 m in 7 minutes, MTw in the heel, 100 Hz. Magnetometer
calibrated on a loop of the same shoe, all methods given the heading at the start. Medians over the walks (5 to 95 %).
The walk ends where it began, so the position error is the same however it is laid on the truth. Columns: the filter as
printed (noise of OpenShoe), tuned on seeds below 100 (one setting for both fields: on one alone another may be better),
matched (a filter with a compass that assumes of foot and sensor what the smoother assumes, run forth and back), the
smoother without the field and with it. Smoother and matched are given the whole walk before they answer, the other
filters are not; and the smoother measures the compass's noise on each walk. Classical QMD: the rate of the strength
within a stance, as in Z-E1."""

_CHANCE = """What an IEZ ends off by is chance: the drift of one sensor on one walk, whose calibration the paper does
not describe. The printed figure is about the largest of ours (see the spread)."""

_NO_GATE = """Our classical detector accepts every footfall, on this field too, and so the filter has a compass at each
of them. The places average out, and that ends far nearer than no compass; the paper's is hardly better than its IEZ.
How many footfalls theirs accepted, and how its building turned the field there, is not given."""

_ROUGH = """No sigma is printed. With 10 deg for the test and 5 deg for the compass the filter ends farther off on this
rough floor than the one that accepts every footfall (classical QMD, as printed): the test, or what else it measures
beside the compass, costs it here. Tuned, with 20 deg for the compass, it is off by less."""

_NO_MERIT = """As printed it accepts every footfall on this field, as the classical detector does: that the error is so
small is no merit of the test."""

_WHY = {
    IEZ: (Reason(_CHANCE, BELOW),),
    CLASSICAL: (Reason(_NO_GATE, BELOW),),
    AIEZ: (Reason(_ROUGH, ABOVE, "indoor"), Reason(_NO_MERIT, BELOW, "smooth")),
}


def keys(fields: Sequence[str], seeds: Sequence[int]) -> list[Key]:
    """All that the experiment looks at."""
    return read.keys_of(BUILDING, fields, METHODS, seeds)


def columns_of(filter_name: str) -> dict[str, str]:
    """Methods by column, for the rows of one filter."""
    if filter_name == IEZ:
        return {PRINTED: IEZ + PRESET[PRINTED], TUNED: IEZ, NO_FIELD: INERTIAL}
    filters = {column: filter_name + preset for column, preset in PRESET.items()}
    return filters | ({BOTH_WAYS: MATCHED} if filter_name == AIEZ else {}) | {OURS: SMOOTHER}


def building_experiment(walks: Walks, fields: Sequence[str], pictures: Sequence[Picture]) -> Experiment:
    """Table I, and what it does not print."""
    rows = [*_table_1(walks, fields), *_more(walks, fields)]
    title = "A teaching building, three cycles (Figure 7, Table I)"
    return Experiment("Z-E2", title, one_line(_SETTING), COLUMNS, rows, pictures)


def _table_1(walks: Walks, fields: Sequence[str]) -> Iterator[Row]:
    for name, printed in TABLE_1.items():
        for field in _fields_of(name, fields):
            for (words, unit, figure), value in zip(_ERRORS, printed, strict=True):
                ours = _ours(walks, name, field, figure)
                off = ours[PRINTED].median - float(value)
                why, good = reason_for(_WHY[name], field, off), -1 if name == AIEZ else 0
                quantity = f"{words}, {_where(name, field)}"
                yield Row(quantity, unit, value, ours, float(value), PRINTED, good=good, why=why)


_ERRORS = (("position error", "m", read.end_m), ("TTD error", "%", read.end_percent))


def _more(walks: Walks, fields: Sequence[str]) -> Iterator[Row]:
    """What the paper does not print."""
    for words, unit, figure, pattern in _UNPRINTED:
        for name in TABLE_1:
            if name == IEZ and figure is read.used_percent:
                continue
            for field in _fields_of(name, fields):
                ours = _ours(walks, name, field, figure)
                yield Row(f"{words}, {_where(name, field)}", unit, "", ours, pattern=pattern)


_UNPRINTED: tuple[tuple[str, str, Figure, str], ...] = (
    ("mean position error", "m", read.mean_m, "{:.2f}"),
    ("final heading error", "deg", read.heading_deg, "{:.1f}"),
    ("footfalls with an accepted field", "%", read.used_percent, "{:.0f}"),
)


def _fields_of(name: str, fields: Sequence[str]) -> Sequence[str]:
    """The IEZ does not use the field."""
    return fields[:1] if name == IEZ else fields


def _where(name: str, field: str) -> str:
    return NAMES[name] if name == IEZ else f"{NAMES[name]}, {field}"


def _ours(walks: Walks, name: str, field: str, figure: Figure) -> dict[str, Spread]:
    return {
        column: read.spread_over(results, figure)
        for column, method in columns_of(name).items()
        if (results := walks.of(BUILDING, field, method))
    }


def figure_7(pictures: Pictures, walks: Walks, fields: Sequence[str]) -> Picture:
    """Trajectories of the three filters in the building."""
    with style.styled():
        figure, panels = new_panels(1, len(fields), 5.0, 4.8 * len(fields) + 0.4)
        for axes, field in zip(panels, fields, strict=True):
            colours = (palette.ORANGE, palette.VERMILION, palette.BLUE)
            for (name, words), colour in zip(NAMES.items(), colours, strict=True):
                results = walks.of(BUILDING, field, columns_of(name).get(PRINTED, name))
                result = next((result for result in results if not result.failed), None)
                if result is not None:
                    truth = truth_of(result) if not axes.lines else None
                    draw_path(axes, estimate_of(result), words, colour, truth)
            style.head(axes, f"The teaching building, field {field}", columns=2)
    return pictures.keep(
        figure, 7, "trajectories of IEZ, IEZ + classical QMD and AIEZ", f"the filters {PRINTED}; squares: ends"
    )
