"""What is said in words beside the figures of Munoz Diaz et al. (2017): settings, reasons, and what differs.

No figure depends on these words: to change them makes no seed again.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from fg_nav.lab.reproduce.munoz_diaz2017.walks import FIELDS_UT, PUBLISHED

CITATION = (
    "Munoz Diaz, E.; de Ponte Müller, F.; García Domínguez, J. J. (2017). Use of the Magnetic Field for Improving "
    "Gyroscopes' Biases Estimation. Sensors 17(4), 832."
)

DIFFERS = (
    "The paper has one person and two walks, the first with a fibre-optic gyroscope, the second with an MTw. Ours are "
    "simulated, two a seed, each with a person, a gait, noises and iron drawn again: its single figures stand beside "
    "our medians.",
    "Not printed, and chosen on seeds below 100 with the paper's figures in view: the prior of the bias, 0.035 deg/s "
    "(seeds 1 to 4), which alone sets how many minutes the z bias takes, so that their ratios are a result and their "
    "size is none; and the noise of the MTw's magnetometer, 0.05 uT (seeds 1 and 2), which sets what an uncalibrated "
    "one does; and the trips of the second walk, six of 720 m, which fit the 50 deg of gravity alone. Rows that rest "
    "on these are 'put in'. The detector, where cars and lamps stand, and the iron are ours; our walker bows some "
    "metres towards those that he comes close to.",
    "The paper takes gravity from single samples, where the force is not disturbed. On a simulated thigh single "
    "samples are not gravity, and the filter as printed goes off by tens of degrees; the filter here takes a mean over "
    "two strides, turned by the gyroscope, and has the paper's misprints corrected.",
    "The graph is not the paper's: the local field is a variable in it, where the filter takes the difference of two "
    "noisy samples for exact. Batch is given the whole walk before it answers; online, each estimate is made of what "
    "was there until then. It has no way without its own weighing of perturbed fields.",
    "By default the graph assumes what a real sensor has: errors of scale and axes of the gyroscope, and some in the "
    "magnetometer that change with the attitude. The emulated sensor of the first walk has neither. The paper's filter "
    "takes that for granted, and so the graph is given that; on the second walk it has its defaults.",
    "The printed lengths do not agree: six legs of 600 m are not 3 km, and 30 m at 20 deg and 140 m at 50 deg are not "
    "of one length of way. Walked are legs of 500 m in the first walk, and six round trips of 720 m in the second.",
)

_FIRST = (
    "First walk: 3 km to and fro in 39 min, z along the thigh, rates with the errors of Table 2, magnetometer with "
    f"{PUBLISHED.mag_noise_uT} uT of noise."
)
_SECOND = (
    "Second walk: 4.3 km in six round trips and 44 min in the field of Munich, with an MTw whose biases go from one "
    "end of Table 3 to the other. Its iron is drawn, and calibrated by an ellipsoid from 400 readings turned about all "
    "ways."
)
_SITES = ", ".join(f"{site} ({', '.join(f'{part:.2f}' for part in field)})" for site, field in FIELDS_UT.items())

TITLES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "D-E0": (
            "Gyroscopes at rest, and the errors that go in (Section 2.2, Figure 5, Tables 1 to 3)",
            "A fibre-optic gyroscope (KVH 1750) lies still for an hour and is integrated; it and the MTw lie for 14 "
            "hours for the Allan deviations. Orders are decimal logarithms of a ratio. Table 1 is taken as printed: "
            f"fields to east, north and up, uT, are {_SITES}.",
        ),
        "D-E1": ("Gravity only (Figure 8)", f"{_FIRST} The magnetometer is not used."),
        "D-E2": (
            "Gravity and the field at three places (Figure 9)",
            f"{_FIRST} Homogeneous fields of Table 1, used without the detector. The last column is the ratio that the "
            "mean square of the field across the thigh leads one to expect, and that field. Minutes of the batch, "
            "which is given the whole walk before it answers, say nothing and are left out.",
        ),
        "D-E2d": (
            "The track turned to north-south (Section 3.1.2)",
            "As before; the field is turned instead of the walk. Times over those of the walk to the east.",
        ),
        "D-E3": (
            "Past cars and lamps (Figures 7 and 10)",
            f"{_FIRST} The field of the equator with iron cylinders that one passes at 16, 24, 32 and 35 min; it is "
            "used always, or by the detector. The graph weighs perturbed fields itself, and stands under the detector.",
        ),
        "D-E4": ("Yaw error (Figure 11)", f"{_FIRST} What the yaw is off by, in the fields above."),
        "D-E5": ("Biases with the MTw (Figure 13)", _SECOND),
        "D-E6": (
            "Trajectory (Figure 14)",
            f"{_SECOND} Displacement is the straight line from the first place to the last. The paper's length of a "
            "step is not printed; ours has its one constant from the whole walk.",
        ),
    }
)
"""Title and setting of each experiment."""

DRIFTS = (
    "The simulated drift is a Gauss-Markov process: behind its bump, of 8e-6 deg/s from 1000 to 3000 s, the FOG's "
    "Allan deviation falls again, and the lowest point of 14 h lies near their end. At the bump it is 2.7 orders below "
    "the MTw's; both are of data sheets as we remember them."
)

ONE_FOG = (
    "It is the offset at switch-on, 1 deg/h an axis (one sigma) of the data sheet as we remember it, of the worst of "
    "three axes. Theirs is one sensor in one hour; ours is drawn again each time."
)

SLOWER = (
    "It increases all along, but more slowly later. That is in part because gravity shows a little of z too while the "
    "thigh swings, and the estimate of it has come some way by then."
)

SWING = (
    "The mean square of the field across the thigh sets it (last column, and last rows). At the pole only the swing of "
    "the thigh brings the field across, and how far theirs swung is not printed."
)

TABLE_1 = (
    "By the fields of Table 1 as printed, z is as easy to see in Munich as at the equator (last column, and last "
    "rows). What made theirs slower is not given."
)

ONE_WAY = (
    "Ours goes one way until z is known, for its z bias comes near the true one smoothly; theirs does not (its Figure "
    "9c), and why is not given."
)

RATIO = "As ours needs more of the walk until z is known, it has more of the error of gravity alone."

IRON = "How far rests on the iron and on the noise of the magnetometer that the filter is given; neither is printed."

PRIOR = "The size rests on the prior of the bias, which is not printed."

DETECTOR = (
    "The detector and the places of cars and lamps are not printed: ours lets the field through for longer than theirs."
)

TRIP = (
    "By its own bias of 0.12 deg/s the paper's 20 deg want z found in 3 of the 7 minutes of a trip; its Figures 9c and "
    "13c take 15 minutes and more, and ours takes more than ten."
)

FOLLOWS = "Follows the yaw. The paper's 30 m at 20 deg and 140 m at 50 deg are not of the same length of way."
