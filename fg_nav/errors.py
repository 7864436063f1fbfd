"""Errors a user can cause: one base class, one subclass per module.

The message says what is wrong, where (row of the file, time in the recording) and what to try.
The command line prints it in one line and exits with 1; anything else that escapes is a bug and exits with 70.
"""


class FgNavError(Exception):
    """Base of all errors that the input, not the program, is to blame for.

    Examples
    --------
    >>> try:
    ...     fg_nav.navigate("walk.csv", "by guess")
    ... except fg_nav.FgNavError as error:
    ...     print(str(error).split(":")[0])
    there is no method 'by guess'
    """


class FormatError(FgNavError):
    """A file could not be read as a recording or as truth (`fg_nav.io`)."""


class RecordingError(FgNavError):
    """A recording was read but cannot be navigated with (`fg_nav.recording`)."""


class DetectionError(FgNavError):
    """No stance, or no usable one, was found (`fg_nav.detection`)."""


class MagneticError(FgNavError):
    """The magnetometer has nothing to say, or a detector was asked for that cannot be (`fg_nav.magnetic`)."""


class EarthError(FgNavError):
    """The Earth's field was asked for at a place or date that there is not, or without the model (`fg_nav.earth`)."""


class CalibrationError(FgNavError):
    """A calibration cannot be had from a recording, read from a file or applied (`fg_nav.calibration`)."""


class PlacesError(FgNavError):
    """The places of a walk cannot be saved, read from a file or used (`fg_nav.places`)."""


class EstimationError(FgNavError):
    """An estimator could not produce a solution (`fg_nav.ekf`, `fg_nav.smoother`)."""


class EvaluationError(FgNavError):
    """A solution and a truth cannot be compared (`fg_nav.evaluation`)."""


class VerdictError(FgNavError):
    """A path that is not to be used, where that is an error (`fg_nav.verdict`)."""


class SimulationError(FgNavError):
    """A walk, sensor or field was asked for that cannot be (`fg_nav.lab.simulation`)."""


class StreamError(FgNavError):
    """A source of samples cannot be opened, or its lines cannot be served (`fg_nav.online`)."""


class CampaignError(FgNavError):
    """A campaign cannot be as planned, or cannot go on (`fg_nav.lab.campaign`)."""


class ConfigError(FgNavError):
    """A configuration cannot be read, or does not fit what it is given for (`fg_nav.commands.config`)."""


class PluginError(FgNavError):
    """What another package adds cannot be used (`fg_nav.plugins`)."""


class OutputError(FgNavError):
    """A result could not be written, or would have overwritten one (`fg_nav.report`, `fg_nav.cli`)."""


def describe_reason(error: Exception) -> str:
    """Return why the system refused, in its words, without those that Python adds on an address in brackets."""
    return (getattr(error, "strerror", None) or str(error) or type(error).__name__).lower().partition(" (while")[0]
