"""What the differential field of a walk shows of its gyro bias (`differential_factors`).

a solution   -> place at every sample, gyro bias to linearize at
swings       -> variogram of the field, by turns with the iron that the stances show
stances      -> information on each bias variable -> factors
"""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np

from fg_nav.factors.differential_field import GYRO, FieldNoise, FieldStretches, Iron
from fg_nav.smoother.differential_factors import (
    IRON_UT,
    DifferentialFactors,
    LevelBias,
    Stretches,
    StretchSum,
    find_iron,
    find_stretches,
    fit_variogram,
    measure_noise,
    measure_stretches,
    sum_stretches,
    turn_stretches,
)
from fg_nav.smoother.graph import Trajectory, WalkProblem, biases_of
from fg_nav.system.spilled import drop_pages
from fg_nav.text import format_count

MIN_ROUNDS, MAX_ROUNDS = 2, 4
"""Of variogram and iron in turns: of 20 uT the first leaves a few, as the variogram of the swings hides the stances."""

CLOSE_IRON_UT = 0.2  # A round that moves the iron by less is the last: a tenth of what may be left of it.


def add_differential_field(problem: WalkProblem, values: gtsam.Values, track: Trajectory) -> WalkProblem:
    """Return the problem with the factors of its differential field, by its first solution, where they are asked for.

    `track` is the trajectory of these values (`trajectory_of`).

    Its biases are good to some tenths of a degree per second, so the factors are linearized once: in a stance the
    remainder is a thousandth of the correction, in ten seconds of standing three hundredths.
    """
    recording, nodes = problem.recording, problem.nodes
    if not problem.parameters.magnetic.differential or recording.mag is None:
        return problem
    stretches = find_stretches(recording, nodes, problem.known.rests)
    if len(stretches.start) == 0:
        return problem
    biases = biases_of(nodes, values)[:, GYRO]
    turned = turn_stretches(recording, stretches, track.position, biases[stretches.bias])
    sigma_uT = measure_noise(turned)
    # Iron turns with the body in the swings, too, so that the field varies less once it is known.
    iron = Iron.unknown(IRON_UT)
    for done in range(1, MAX_ROUNDS + 1):
        variogram = fit_variogram(recording.mag - iron.mean_uT, track.position, track.nav_R_body, nodes, sigma_uT)
        if variogram is None:
            return problem
        noise = FieldNoise(variogram, sigma_uT, iron)
        drop_pages()
        stances, standings = _sum_kinds(stretches, turned, noise, len(biases))
        found = find_iron(stances.information, standings.information)
        if done >= MIN_ROUNDS and np.linalg.norm(found.mean_uT - iron.mean_uT) < CLOSE_IRON_UT:
            break
        iron = found
    known = LevelBias(biases, track.nav_R_body[nodes.sample, 2].mean(axis=0))
    drop_pages()
    return replace(problem, differential=DifferentialFactors(stances, standings, noise, known))


def _sum_kinds(
    stretches: Stretches, turned: FieldStretches, noise: FieldNoise, variables: int
) -> tuple[StretchSum, StretchSum]:
    """Return what the stances, and what the standings, show of each bias variable."""
    information, used = measure_stretches(turned, noise)
    stances, standings = (
        sum_stretches(information, stretches.bias, used & those, variables)
        for those in (~stretches.is_standing, stretches.is_standing)
    )
    return stances, standings


def write_note(differential: DifferentialFactors | None) -> tuple[str, ...]:
    """Say by how many stances and standings the gyro bias was observed, and how well."""
    if differential is None or len(differential) == 0:
        return ()
    stances, standings = (int(one.count.sum()) for one in (differential.stances, differential.standings))
    values = np.linalg.eigvalsh(differential.information.matrix)
    values = values[values[:, -1] > 0.0]
    worst, best = np.degrees(1.0 / np.sqrt(np.maximum(np.median(values, axis=0), 1.0)))[[0, -1]]
    where = f"{format_count(stances, 'stance')} and {format_count(standings, 'standing')}"
    return (
        f"gyro bias by the differential field of {where}: to {best:.2g} deg/s in the best direction and "
        f"{worst:.2g} in the worst of each variable, median",
    )
