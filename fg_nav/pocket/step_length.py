"""Length of a step from the angle by which the legs open.

The paper has it from its reference 22 (Munoz Diaz and Mendiguchia Gonzalez 2014, and 2015), which finds the length of a
step to grow with the opening angle of the leg, whatever the speed, and leaves the figures of the law to each person.
Here with one such figure, so that one known distance is enough: two straight legs of length c, open by the angle a,

    length = 2 c sin(a / 2),

c being the constant of the person, m. It is no leg to be measured: knees bend, the pelvis turns along, heel and toe add
to the length, and a sensor in a pocket moves more than the bone.

Default: c is the leg of an adult, 0.90 m, for a hip is 0.53 of the height over the floor, and the height 1.70 m. Then a
usual step of 0.70 m opens the legs by 46 deg. Two real thighs (`qmt_fullbody`) were in view when it was settled on, so
their distance by it is no check; simulated legs need 0.78. Between persons, trousers and the two legs of one person
the constant differs by a tenth and more, which is the sigma of all lengths alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fg_nav.arrays import Floats
from fg_nav.errors import EstimationError

DEFAULT_CONSTANT_M = 0.90
DEFAULT_SIGMA = 0.12
"""Relative, of the default constant: what persons and trousers differ by."""

CALIBRATED_SIGMA = 0.03
"""Relative, of a constant by a known distance: another pace, other trousers, the tape."""

STEP_SIGMA = 0.06
"""Relative, of each step on its own: steps of one opening differ by so much. Assumed; it averages out."""

PLAUSIBLE_M = (0.3, 1.5)
"""No person's constant is outside."""


@dataclass(frozen=True)
class StepLength:
    """Law of the length of a step.

    Attributes
    ----------
    constant_m : c.
    sigma : relative, one standard deviation, of all lengths alike.
    step_sigma : relative, of each step on its own.
    source : of the constant, in words.
    """

    constant_m: float = DEFAULT_CONSTANT_M
    sigma: float = DEFAULT_SIGMA
    step_sigma: float = STEP_SIGMA
    source: str = "default"

    def __post_init__(self) -> None:
        low, high = PLAUSIBLE_M
        if not low <= self.constant_m <= high:
            raise EstimationError(
                f"a step constant of {self.constant_m:.3g} m is no person's ({low:g} to {high:g} m): check the known "
                "distance, or give a step constant in between."
            )

    def of(self, opening: Floats) -> Floats:
        """Lengths (S,) m of steps of these openings (S,) rad."""
        return self.constant_m * chords(opening)


def chords(opening: Floats) -> Floats:
    """Lengths (S,) of steps of these openings (S,) rad, in step constants."""
    return np.asarray(2.0 * np.sin(opening / 2.0))


def calibrate_step_length(opening: Floats, known_distance_m: float) -> StepLength:
    """Find the constant of a person who made steps of these openings (S,) rad over a known distance, m, along the way.

    Raises
    ------
    EstimationError
        Without a step, with no such distance, or if the constant that comes out is no person's.
    """
    if not (np.isfinite(known_distance_m) and known_distance_m > 0):
        raise EstimationError(f"a known distance of {known_distance_m:g} m is none: give the metres walked.")
    if not len(opening):
        raise EstimationError("there is no step to calibrate the step length by: record a walk.")
    return StepLength(float(known_distance_m / chords(opening).sum()), CALIBRATED_SIGMA, source="known distance")


def given_step_length(constant_m: float) -> StepLength:
    """Return the law with a constant that was calibrated before; raises `EstimationError` if it is no person's."""
    return StepLength(constant_m, CALIBRATED_SIGMA, source="given")
