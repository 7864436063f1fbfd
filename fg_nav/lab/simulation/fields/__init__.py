"""Magnetic fields as functions of place: the Earth's, and what steel does to it.

Model
-----
A field is the flux density B(x) in uT at a place x in m, both in nav (East-North-Up), and static: a `Field`. Fields
of separate sources add (`Sum`). Away from sources every map here is free of divergence and curl, as `gradient`,
`divergence` and `curl` tell by differences; `scripts/field_maps.py` prints it for each, and draws it.

============ ======================================================= ==============================================
file         what                                                    source
============ ======================================================= ==============================================
earth        homogeneous: sites, any strength and dip, World         Munoz Diaz 2017 Table 1; WMM2025
             Magnetic Model
cylinder     upright iron cylinders, each alone in its cell: a       Munoz Diaz 2017 Eq. 21-23, Figure 4
             street
dipole       magnets and magnetised steel                            mu_0 / 4 pi (3 (m.u) u - m) / r^3; Osborn 1945
circuit      stray direct currents in closed polygons                Biot and Savart
floor        a reinforced floor: random harmonic potential           fitted to real walks
treads       the same for stairs: steel buried under the way         fitted to `floor`
objects      pillars, lockers, door frames, beams, beside a way      fitted to real walks
levels       `homogeneous`, `smooth`, `indoor`                       `scripts/realism_field.py`
============ ======================================================= ==============================================

Two exceptions, both on purpose: the cylinder with its exponent as printed in the paper, which is no magnetic field,
and the jump from cell to cell of a street.

An environment is drawn about the ways of a walk: `environment("indoor", SITES["munich"], ways, rng)`. A magnet on the
floor is added to it: `Sum((field, magnet(position, moment)))`.
"""

from fg_nav.lab.simulation.fields.circuit import Circuit, upright_loop
from fg_nav.lab.simulation.fields.cylinder import AS_PRINTED, PAST_CARS, PHYSICAL, TEMPLATE, Cylinders, street
from fg_nav.lab.simulation.fields.dipole import Dipoles, magnet, rod, sphere_moment, spheroid_moment
from fg_nav.lab.simulation.fields.earth import SITES, Homogeneous, earth_at, earth_field, site
from fg_nav.lab.simulation.fields.field import Field, Sum
from fg_nav.lab.simulation.fields.floor import Floor, FloorParameters, draw_floor
from fg_nav.lab.simulation.fields.gradient import curl, divergence, gradient
from fg_nav.lab.simulation.fields.levels import LEVELS, Clutter, environment
from fg_nav.lab.simulation.fields.objects import Cables, Kind, place_cables, place_objects
from fg_nav.lab.simulation.fields.treads import TreadParameters, draw_treads
from fg_nav.lab.simulation.fields.ways import Ways, closely_spaced

__all__ = [
    "AS_PRINTED",
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
    "Homogeneous",
    "Kind",
    "Sum",
    "TreadParameters",
    "Ways",
    "closely_spaced",
    "curl",
    "divergence",
    "draw_floor",
    "draw_treads",
    "earth_at",
    "earth_field",
    "environment",
    "gradient",
    "magnet",
    "place_cables",
    "place_objects",
    "rod",
    "site",
    "sphere_moment",
    "spheroid_moment",
    "street",
    "upright_loop",
]
