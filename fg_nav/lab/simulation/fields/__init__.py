"""Magnetic fields as functions of place: the Earth's, and what steel does to it.

Model
-----
A field is the flux density B(x) in uT at a place x in m, both in nav (East-North-Up), and static: a `Field`. Fields
of separate sources add (`Sum`). Away from sources every map here is free of divergence and curl, as `gradient`,
`divergence` and `curl` show by differences; `field_maps.py` of b894e160 printed it for each and drew it.

========= ========================================================== ==============================================
file      what                                                       source
========= ========================================================== ==============================================
field     sums and derivatives; homogeneous: sites, any strength     MD Table 1; WMM2025
          and dip, World Magnetic Model
cylinder  upright iron cylinders, each alone in its cell: a street   MD (21)-(23), Figure 4
sources   magnets and magnetized steel; stray currents in closed     mu_0 / 4 pi (3 (m.u) u - m) / r^3; Osborn 1945;
          polygons                                                   Biot and Savart
floor     a reinforced floor: random harmonic potential; for         fitted to real walks
          stairs, steel buried under the path
building  pillars, lockers, door frames, beams next to a path;       fitted to real walks; docs/simulation.md
          `homogeneous`, `smooth`, `indoor`, `indoor-old`
========= ========================================================== ==============================================

Two exceptions, both on purpose: the cylinder with its exponent as printed in the paper, which is no magnetic field,
and the jump from cell to cell of a street.

An environment is drawn about the path of a walk: `draw_environment("indoor", SITES["munich"], points, rng)`. A magnet
on the floor is added to it: `Sum((field, magnet(position, moment)))`.
"""

from fg_nav.lab.simulation.fields.building import (
    CLUTTERS,
    LEVELS,
    Cables,
    Clutter,
    Kind,
    draw_environment,
    place_cables,
    place_objects,
)
from fg_nav.lab.simulation.fields.field import (
    AS_PRINTED,
    PAST_CARS,
    PHYSICAL,
    SITES,
    TEMPLATE,
    Cylinders,
    Field,
    Homogeneous,
    Sum,
    curl,
    divergence,
    find_earth_field,
    gradient,
    make_earth_field,
    site,
    street,
)
from fg_nav.lab.simulation.fields.floor import (
    Floor,
    FloorParameters,
    FloorPath,
    draw_floor,
    draw_treads,
    resample_path,
)
from fg_nav.lab.simulation.fields.sources import (
    Circuit,
    Dipoles,
    compute_sphere_moment,
    compute_spheroid_moment,
    magnet,
    make_upright_loop,
    rod,
)

__all__ = [
    "AS_PRINTED",
    "CLUTTERS",
    "LEVELS",
    "PAST_CARS",
    "PHYSICAL",
    "SITES",
    "TEMPLATE",
    "Cables",
    "Circuit",
    "Clutter",
    "Cylinders",
    "Dipoles",
    "Field",
    "Floor",
    "FloorParameters",
    "FloorPath",
    "Homogeneous",
    "Kind",
    "Sum",
    "compute_sphere_moment",
    "compute_spheroid_moment",
    "curl",
    "divergence",
    "draw_environment",
    "draw_floor",
    "draw_treads",
    "find_earth_field",
    "gradient",
    "magnet",
    "make_earth_field",
    "make_upright_loop",
    "place_cables",
    "place_objects",
    "resample_path",
    "rod",
    "site",
    "street",
]
