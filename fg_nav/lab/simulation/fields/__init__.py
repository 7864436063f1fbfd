"""Magnetic fields as functions of place: the Earth's, and what steel does to it.

A field is the flux density B(x) in uT at a place x in m, both in nav (East-North-Up), and static: a `Field`. Fields
of separate sources add (`Sum`). Away from sources every map here is free of divergence and curl.

`field` has the sources in closed form: the Earth's field (MD Table 1, WMM2025), dipoles and spheroids (Osborn 1945),
circuits (Biot and Savart), and streets of upright iron cylinders, each alone in its cell (MD (21)-(23), Figure 4).
`building` has what is fitted to real walks (docs/simulation.md): floors, stairs, objects, stray currents, by level.

Two exceptions, both on purpose: the cylinder with its exponent as printed in the paper, which is no magnetic field,
and the jump from cell to cell of a street.

An environment is drawn about the path of a walk: `draw_environment("indoor", SITES["munich"], points, rng)`. A magnet
on the floor is added to it: `Sum((field, magnet(position, moment)))`.
"""

from fg_nav.lab.simulation.fields.building import LEVELS, draw_environment, draw_floor
from fg_nav.lab.simulation.fields.field import (
    AS_PRINTED,
    PAST_CARS,
    PHYSICAL,
    SITES,
    TEMPLATE,
    Circuit,
    Cylinders,
    Dipoles,
    Field,
    Homogeneous,
    Sum,
    find_earth_field,
    magnet,
    make_earth_field,
    street,
)

__all__ = [
    "AS_PRINTED",
    "LEVELS",
    "PAST_CARS",
    "PHYSICAL",
    "SITES",
    "TEMPLATE",
    "Circuit",
    "Cylinders",
    "Dipoles",
    "Field",
    "Homogeneous",
    "Sum",
    "draw_environment",
    "draw_floor",
    "find_earth_field",
    "magnet",
    "make_earth_field",
    "street",
]
