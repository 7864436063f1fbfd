"""All experiments of Zhang et al. (AIEZ, 2017): the magnet on the floor, and the teaching building."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from fg_nav.lab.campaign.walks import LOOP
from fg_nav.lab.reproduce.aiez2017 import figures as figures
from fg_nav.lab.reproduce.aiez2017.corridor import DETECTOR_OF, STRENGTHS, corridor_experiment
from fg_nav.lab.reproduce.aiez2017.magnet import SCENARIO, STRONGER, magnet_part, walks_of
from fg_nav.lab.reproduce.aiez2017.walks import IEZ, building_experiment, keys
from fg_nav.lab.reproduce.drawing import Pictures
from fg_nav.lab.reproduce.results import Reproduction, one_line
from fg_nav.lab.reproduce.walks import describe_other_code, describe_walks, parameters_of, read_walks, run_missing
from fg_nav.lab.store.results import Key

PAPER = "aiez2017"

CITATION = (
    "L. Zhang, K. Guo and Y. Liu: Pedestrian Dead Reckoning System using Quasi-static Magnetic Field Detection. 2017."
)

FIELDS = ("smooth", "indoor")

_PAST_MAGNET = Key(SCENARIO.name, FIELDS[0], "", LOOP, IEZ)
"""For the parameters of the scenario of Z-E1, whose walks are kept as parts."""

CORRIDORS = 20
"""The first seeds of a run that are enough: of a quick one, and of walks past the magnet."""


def reproduce(
    folder: Path,
    seeds: Sequence[int],
    workers: int = 2,
    progress: Callable[[float], None] | None = None,
    quick: bool = False,
) -> Reproduction:
    """Make all experiments of the paper; what is kept in the folder from an earlier run is taken up.

    Parameters
    ----------
    folder : for walks (`cells`), other measurements (`parts`) and pictures.
    seeds : of the simulated walks.
    workers : processes.
    progress : called with the fraction done.
    quick : leaves out nothing but seeds.

    Raises
    ------
    OutputError
        Where the folder cannot be written.
    """
    corridors, wanted = seeds[:CORRIDORS], keys(FIELDS, seeds)
    parts = [magnet_part(strength, seed) for strength in STRENGTHS for seed in corridors]
    run_missing(folder, wanted, parts, workers, progress)
    walks, pictures = read_walks(folder, wanted), Pictures(folder, PAPER)
    past = {strength: walks_of(folder, strength, corridors) for strength in STRENGTHS}
    drawn = magnet_part(STRONGER, seeds[0]).load(folder)
    return Reproduction(
        paper=PAPER,
        citation=CITATION,
        seeds=tuple(seeds),
        experiments=[
            corridor_experiment(past, [figures.figure_5(pictures, drawn), figures.figure_6(pictures, drawn)]),
            building_experiment(walks, FIELDS, [figures.figure_7(pictures, walks, FIELDS)]),
        ],
        differs=[one_line(text) for text in (*_DIFFERS, *describe_other_code(walks))],
        parameters=parameters_of(walks) | describe_walks([*wanted, _PAST_MAGNET], DETECTOR_OF.values()),
    )


_DIFFERS = (
    """The paper has one walk of each kind; ours are simulated, many times over, with a foot, a sensor and a building
    drawn anew by each seed.""",
    """No window, sigma, threshold, Q, R or P0 is printed. The filter as printed has Zhang's equations with 10 deg and
    0.5 uT/s in the test and 5 deg for the compass, and OpenShoe's noise. What would break it is put right and told in
    each result: the sign of the compass, AIEZ (25), angles, AIEZ (20), (27), the axes of the errors of roll and pitch,
    AIEZ (22), (29).""",
    """Table I does not say what a position error is. Ours is that of the last footfall from the first, and as the walk
    ends where it began, it does not depend on how the path is laid on the truth.""",
    """The IEZ of the paper's one walk ends farther off than that of most of ours. So the gain of AIEZ over the IEZ is
    smaller here.""",
    """The classical detector has no printed threshold either. Ours, the rate of the strength within a stance, believes
    the field beside the magnet, as the paper shows, but also everywhere else: IEZ + classical QMD is a filter with a
    compass at every footfall here, far better than in Table I and on the rough floor better than AIEZ as printed.""",
    """The smoother, and the matched filter both ways, are told the whole walk before they answer; the paper's filters
    answer at each step. The columns are no race between equals.""",
)
