"""What the smoother believes of the magnetic field, of the magnetometer, and of what it reads.

How rough the field is, and over what distance, no parameter says: it is measured on the walk (`field_noise`).
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FieldParameters:
    """Defaults for a magnetometer on a shoe; `docs/magnetic.md` tells how each was chosen."""

    compass: bool = True
    """Use the direction of the field at each footfall."""
    potential: bool = True
    """Use the line integral of the field along the way."""
    rounds: int = 2
    """How often noise and verdicts are taken anew from the smoothed walk: the first time from a walk without the field,
    whose heading has drifted."""
    first_convergence: float = 0.05
    """How near its minimum the walk without the field has to be to look at the field along it, as `convergence` of the
    smoother: by then it is millimetres and thousandths of a degree a stride from there."""
    gate: str | None = None
    """A detector of a quasi-static field (`fg_nav.magnetic.quasi_static`) that a footfall has to pass; None for the
    walk's own spread alone."""
    outside_gate: float = 3.0
    """By how much larger the compass's noise is where the detector does not pass the field; infinite: not used."""
    outlier_sigmas: float = 5.0
    """A footfall is disturbed where its field is off by more than this many robust sigmas of the walk's own spread: of
    a field with the heavy tails of real ones (kurtosis 6) one in a thousand."""

    reference_sigma_deg: float = 1.0
    """How well compass and given heading have the same north, deg: declination, mounting, soft iron."""
    strength_sigma_uT: float = 5.0
    """Horizontal strength of the field about the walk's median, uT."""
    mean_walk_uT: float = 0.003
    """By how much the building's mean field changes from stride to stride, uT: 0.1 uT over a kilometre and a half."""
    regional_share: float = 3.0
    """What rooms and wings of a building do to the compass, as a share of how the field differs from footfall to
    footfall, before the walk has shown it: wide, for one who is wrong here on a short walk bends it; nothing in a
    homogeneous field."""
    regional_share_of_mean: float = 0.3
    """What of that is left in the mean field of a short walk, from which north is taken where nobody told a heading."""
    regional_length_m: float = 20.0
    """For how long."""
    regional_weight: float = 5.0
    """How many regions' worth of evidence this assumption is: a walk through more of them learns its own value."""
    hard_iron_level_uT: float = 0.3
    """Hard iron left in the stance's level plane after a calibration, uT."""
    hard_iron_up_uT: float = 15.0
    """The same upward: a calibration from footfalls cannot see it, and in a swing it turns forward."""
    hard_iron_walk_uT: float = 5e-3
    """Its random walk from stride to stride, uT: 0.16 uT in a thousand. A tilt that is wrong in every swing looks like
    iron too, and changes with the gait."""

    compass_sigma_uT: float = 0.3
    """Noise of a footfall's mean field, uT: what levelling and a soft sole leave, white from stride to stride."""
    way_sigma_uT_m: float = 0.1
    """Noise of the line integral over a stride, uT m: sampling, and what scale errors leave."""
    potential_least_way_m: float = 300.0
    """Shorter walks do without the line integral: they cannot tell how far the building's potential reaches, and take
    too little for it (ten real walks of 35 to 150 m, `scripts/real_walks.py`)."""
    coarsest_m: float = 0.4
    """Longest move between two samples of the field that a line integral passes over: the floor's steel is as near."""
    least_strength_uT: float = 3.0
    """Horizontal strength below which there is no compass."""
