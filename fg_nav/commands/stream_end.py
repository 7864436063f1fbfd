"""A walk that was followed to its end, as a session and an outcome: what `fg-nav run` makes of a recording.

The stances and the field are looked for anew in all that was recorded, and the smoother is run on the whole walk. With
a lag there is only what left it: one row a stance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fg_nav.calibration.file import Calibration
from fg_nav.estimators import Progress
from fg_nav.online import OnlineNavigator
from fg_nav.online.smoother import OnlineOptions
from fg_nav.recording import Provenance
from fg_nav.session import Options, Outcome, Session, measured, prepare


def result(
    navigator: OnlineNavigator, name: str, calibration: Calibration | None = None, progress: Progress | None = None
) -> tuple[Session, Outcome]:
    """Solve the walk as a whole.

    Parameters
    ----------
    navigator
        Without a lag.
    name
        Of the source.
    calibration
        That was applied on the way; for the record only.
    progress
        Told from time to time which fraction is done.

    Raises
    ------
    RecordingError, DetectionError, EstimationError
        Where there was no walk.
    """
    recording = replace(navigator.recording(), provenance=Provenance(format=f"canonical rows from {name}"))
    session = prepare(recording, _options(navigator.options))
    if calibration is not None:
        session = replace(session, calibration=calibration, applied=calibration.corrects(recording.mag is not None))
    solution = navigator.finish(progress, session.stances, session.field)
    if len(solution.stances) != session.stances.n_footfalls:  # it could not be solved, and has the rows told on the way
        session = replace(session, stances=navigator.stances(), field=None, verdicts=None)
    return session, measured(session, solution)


def _options(options: OnlineOptions) -> Options:
    heading_deg = None if options.heading_rad is None else float(np.degrees(options.heading_rad))
    return Options(use_magnetometer=options.use_field, heading_deg=heading_deg)
