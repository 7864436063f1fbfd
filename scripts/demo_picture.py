"""The picture of the README: a real walk over surveyed footprints, and half an hour in a simulated mall, from above.

    python scripts/demo_picture.py --figure docs/demo.png [--data DIR]

Left walk 33 of gdin, a LORD GX5 on the instep, with its magnetometer as recorded. Right the scenario `mall`, seed 101,
with a calibrated magnetometer on the floor of a building (field `indoor`). Both paths are aligned with the truth by yaw
and shift.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import harness
import numpy as np
import walks
from matplotlib.axes import Axes

from fg_nav.io import read
from fg_nav.lab import palette
from fg_nav.lab.simulation import Choices, simulate
from fg_nav.pipeline import prepare_walk, run_method
from fg_nav.recording import Recording
from fg_nav.report.plots import style
from fg_nav.truth import FootprintTruth, TrajectoryTruth
from fg_nav.walk import Walk

WALK = 33
DRAWN = {"smoother": "fg-nav", "iez": "zero-velocity filter (IEZ)"}
COLORS = {"smoother": palette.BLUE, "iez": palette.VERMILION}
MAX_POINTS = 4000


def main(arguments: Sequence[str] | None = None) -> None:
    """Solve both walks and draw them."""
    chosen = harness.parse_arguments(__doc__, arguments, figure=None, data=None)
    real = read(walks.gdin_path(walks.data_folder(chosen.data), WALK))
    mall = simulate("mall", 101, Choices(calibrated=True)).recording
    with style.styled():
        picture = style.new_figure(4.2, width_in=10.5)
        left, right = picture.subplots(1, 2, width_ratios=(1.55, 1.0))
        errors = draw_walk(left, real, ("iez", "smoother"))
        words = f"{errors['smoother']:.2f} m rms, filter {errors['iez']:.2f}"
        left.set_title(f"A real walk of 64 m, with its magnetometer: {words}")
        errors = draw_walk(right, mall, ("iez", "smoother"))
        words = f"{errors['smoother']:.1f} m rms, filter {errors['iez']:.1f}"
        right.set_title(f"Simulated, 2.5 km: {words}")
        right.set_ylabel("")
    harness.save_picture(picture, chosen.figure)


def draw_walk(axes: Axes, recording: Recording, methods: Sequence[str]) -> Mapping[str, float]:
    """Draw the paths of the methods over the truth; returns the rmse of each, m."""
    walk, errors = prepare_walk(Walk.of(recording)), {}
    truth = walk.truth
    if isinstance(truth, TrajectoryTruth):
        path = truth.position[:: len(truth.position) // MAX_POINTS + 1]
        axes.plot(*path[:, :2].T, **palette.TRUTH_LINE, label="truth")
    elif isinstance(truth, FootprintTruth):
        axes.plot(*truth.xy.T, "s", color=palette.TRUTH, markersize=4.5, label="surveyed footprints")
    for method in methods:
        outcome = run_method(walk, method)
        assert outcome.comparison is not None
        position = outcome.comparison.alignment.apply(outcome.solution.position)
        path = position[:: len(position) // MAX_POINTS + 1]
        thin = 0.8 if method == "iez" else 1.2
        axes.plot(*path[:, :2].T, color=COLORS[method], linewidth=thin, label=DRAWN[method])
        errors[method] = float(np.asarray(outcome.metrics.rmse_2d_m))
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="m", ylabel="m")
    axes.legend(loc="best", frameon=False)
    return errors


if __name__ == "__main__":
    harness.run(main)
