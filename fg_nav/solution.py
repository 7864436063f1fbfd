"""What every estimator returns: the dense trajectory, a table with one row a stance, and how it was made.

Sigmas are one standard deviation of the estimator's own claim; the evaluation tests whether they are true.

A solution knows its tables. That it is saved and drawn by its own methods is for those who type: these reach the report
through the public names of `fg_nav`, as a user does, and this module imports none of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np

import fg_nav
from fg_nav.arrays import Brief, Floats, Ints
from fg_nav.errors import EstimationError
from fg_nav.frames import compute_heading, quaternion_xyzw
from fg_nav.recording import Recording

if TYPE_CHECKING:
    import pandas as pd

Rows: TypeAlias = Literal["samples", "footfalls", "strides"]
"""What a table of a solution has a row of."""

SAMPLE_COLUMNS = (
    "time_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "heading_deg", "qx", "qy", "qz", "qw",
)  # fmt: skip
STRIDE_COLUMNS = (
    "index", "time_s", "x_m", "y_m", "z_m", "heading_deg",
    "gyro_bias_x_deg_s", "gyro_bias_y_deg_s", "gyro_bias_z_deg_s",
    "sigma_x_m", "sigma_y_m", "sigma_z_m", "sigma_heading_deg", "field", "field_reason",
    "cov_xy_m2", "cov_xz_m2", "cov_yz_m2", "same_place_as", "place_score",
    "gyro_bias_sigma_x_deg_s", "gyro_bias_sigma_y_deg_s", "gyro_bias_sigma_z_deg_s", "compass_weight",
)  # fmt: skip


@dataclass(frozen=True)
class StanceTable(Brief):
    """One row a stance, taken at its representative (stillest) sample; None where the estimator does not tell."""

    sample: Ints  # (K,) index into the recording
    t: Floats  # (K,) s
    position: Floats  # (K, 3) m, navigation frame
    nav_R_body: Floats  # (K, 3, 3)
    gyro_bias: Floats  # (K, 3) rad/s, body frame
    position_cov: Floats  # (K, 3, 3) m^2, navigation frame
    heading_sigma: Floats  # (K,) rad
    gyro_bias_sigma: Floats  # (K, 3) rad/s
    field: tuple[str, ...]  # (K,) verdict on the magnetic field: "none" where it was not used
    field_reason: tuple[str, ...]  # (K,) the verdict in words
    pose_cov: Floats | None = None  # (K, 4, 4) of east, north, up (m) and yaw about up (rad) together
    move_cov: Floats | None = None  # (K, 4, 4) likewise, of the move from the footfall before; NaN of the first
    same_place: Ints | None = None  # (K,) earlier footfall at the place, recognized by its field; -1 none
    place_score: Floats | None = None  # (K,) log likelihood ratio of that, nats; 0 where there is none
    # (K,) information of the footfall's compass over that at the walk's own spread, at most 1; 0 where it has no
    # reading or is not used
    compass_weight: Floats | None = None
    field_statistic: Floats | None = None  # (K,) detector's statistic over its threshold; NaN where not judged
    # (K,) sigma, rad/s, of the gyro bias about up by the differential field of the stances near the footfall alone; NaN
    # where it shows none
    differential_sigma: Floats | None = None

    def __len__(self) -> int:
        return len(self.sample)

    @property
    def position_sigma(self) -> Floats:
        """(K, 3) standard deviations of position, m."""
        return np.sqrt(np.diagonal(self.position_cov, axis1=1, axis2=2))

    @property
    def position_yaw_cov(self) -> Floats:
        """`pose_cov`; of an estimator that has none, without the cross-covariance of position and yaw."""
        if self.pose_cov is not None:
            return self.pose_cov
        cov = np.zeros((len(self), 4, 4))
        cov[:, :3, :3], cov[:, 3, 3] = self.position_cov, self.heading_sigma**2
        return cov

    def to_dataframe(self) -> pd.DataFrame:
        """Return a table of `STRIDE_COLUMNS`, one row a stance; headings in [0, 360) deg clockwise from north."""
        import pandas as pd

        columns = [
            np.arange(len(self)), self.t, *self.position.T, _heading_deg(self.nav_R_body),
            *np.rad2deg(self.gyro_bias).T, *self.position_sigma.T, np.rad2deg(self.heading_sigma), self.field,
            self.field_reason, *self.position_cov[:, [0, 0, 1], [1, 2, 2]].T,
            np.full(len(self), -1) if self.same_place is None else self.same_place,
            np.zeros(len(self)) if self.place_score is None else self.place_score,
            *np.rad2deg(self.gyro_bias_sigma).T,
            np.full(len(self), np.nan) if self.compass_weight is None else self.compass_weight,
        ]  # fmt: skip
        return pd.DataFrame(dict(zip(STRIDE_COLUMNS, columns, strict=True)))


def tabulate_path(t: Floats, position: Floats, velocity: Floats, nav_R_body: Floats) -> pd.DataFrame:
    """Table of `SAMPLE_COLUMNS`, one row a sample; headings in [0, 360) deg clockwise from north."""
    import pandas as pd

    columns = [t, *position.T, *velocity.T, _heading_deg(nav_R_body), *quaternion_xyzw(nav_R_body).T]
    return pd.DataFrame(dict(zip(SAMPLE_COLUMNS, columns, strict=True)))


def _heading_deg(nav_R_body: Floats) -> Floats:
    return np.rad2deg(compute_heading(nav_R_body)) % 360.0


@dataclass(frozen=True)
class KnownStretch(Brief):
    """A stretch of a walk that was recognized, by the field along it, as one of an earlier walk that was saved."""

    other: ClassVar[str] = "known"  # the earlier pass in `summary.json`

    t: Floats  # (M,) s, of the points of this pass and of those of the earlier one at the same places, in its own time
    earlier_t: Floats
    opposite: bool  # whether it was walked in the opposite direction
    score: float  # log likelihood ratio of one place against two, nats
    expected_false: float  # recognitions as good as this one that chance would make in the whole walk
    length_m: float  # of this pass

    def describe(self) -> dict[str, object]:
        """Return what goes into `summary.json`."""
        begin, end, other_begin, other_end = map(float, (self.t[0], self.t[-1], self.earlier_t[0], self.earlier_t[-1]))
        other = {f"{self.other}_begin_s": other_begin, f"{self.other}_end_s": other_end}
        own = ("opposite", "length_m", "score", "expected_false")
        return {"begin_s": begin, "end_s": end, **other, **{name: getattr(self, name) for name in own}}


@dataclass(frozen=True)
class Return(KnownStretch):
    """A stretch of a walk that was recognized as one where the same walk was before."""

    other: ClassVar[str] = "earlier"

    field_uT: Floats  # (M, 3) along the direction of walking of this pass, to its left, and up
    earlier_field_uT: Floats


@dataclass(frozen=True)
class Located:
    """Start of a walk in the frame of an earlier one whose places were saved."""

    position: Floats  # (3,) m, of its first footfall
    heading: float  # rad clockwise from north, of the body's x axis there
    sigma: Floats  # (4,) of position, m, and heading, rad
    expected_false: float  # recognitions as good as this one that chance would make
    recording: str  # name of that of the earlier walk
    stretches: tuple[KnownStretch, ...]  # that were recognized

    @property
    def sentence(self) -> str:
        """Where the known places put the walk, in one sentence for the user."""
        first, length = self.stretches[0], sum(one.length_m for one in self.stretches)
        (x, y, z), sigma = self.position, float(np.hypot(*self.sigma[:2]))
        return (
            f"on the places of {self.recording or 'an earlier walk'}, by {length:.0f} m that were recognized, first "
            f"the stretch from {first.t[0]:.0f} to {first.t[-1]:.0f} s as its {first.earlier_t[0]:.0f} to "
            f"{first.earlier_t[-1]:.0f} s: the start is at {x:.2f}, {y:.2f}, {z:.2f} m within {sigma:.2f} m (1 sigma), "
            f"its heading {np.rad2deg(self.heading) % 360.0:.1f} deg within {np.rad2deg(self.sigma[3]):.1f}"
        )

    def describe(self) -> dict[str, object]:
        """Return what goes into `summary.json`."""
        names = ("sigma_x_m", "sigma_y_m", "sigma_z_m")
        return {
            **dict(zip(("x_m", "y_m", "z_m"), map(float, self.position), strict=True)),
            "heading_deg": float(np.rad2deg(self.heading) % 360.0),
            **dict(zip(names, map(float, self.sigma[:3]), strict=True)),
            "sigma_heading_deg": float(np.rad2deg(self.sigma[3])),
            "expected_false": self.expected_false,
            "recording": self.recording,
            "stretches": [one.describe() for one in self.stretches],
        }


@dataclass(frozen=True)
class Solution:
    """A walk as an estimator saw it. Arrays are at the recording's rate.

    `t` (N,) s; `position` (N, 3) m; `velocity` (N, 3) m/s; `nav_R_body` (N, 3, 3).
    `parameters` are the effective ones, ready for JSON; `notes` are remarks for the user. `moment` is what an online
    estimator estimated at each footfall when it was complete, before it knew what came after; None from all others.
    `graph` counts its factors by kind (`smoother.graph`), empty where there is none.
    `distance_sigma_m` is that of the distance travelled, the sum of the moves from stance to stance; None where the
    estimator does not tell.
    `polished` is the batch solution of the same walk, where an online estimator was asked for it.
    `recording` has the samples as they were integrated, with clipped peaks as high and rates of the scale that the walk
    showed; None where they are those that were given. `returns` are the stretches at which the walk was before.
    `located` says where it begins in the frame of an earlier walk, which is then that of all of it; None where it is in
    a frame of its own. `uses_field` is whether the estimator is one that makes use of the magnetic field.

    Examples
    --------
    >>> recording = fg_nav.read("walk.csv")
    >>> solution = fg_nav.run_iez(recording, fg_nav.detect_stances(recording))
    >>> solution.nav_R_body.shape == (len(recording), 3, 3)
    True
    >>> solution.stances.position_cov.shape == (17, 3, 3)  # m^2
    True
    """

    method: str
    t: Floats
    position: Floats
    velocity: Floats
    nav_R_body: Floats
    stances: StanceTable
    runtime_s: float
    parameters: Mapping[str, object] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    graph: Mapping[str, int] = field(default_factory=dict)
    distance_sigma_m: float | None = None
    moment: StanceTable | None = None
    polished: Solution | None = None
    recording: Recording | None = None
    returns: tuple[Return, ...] = ()
    located: Located | None = None
    uses_field: bool = True

    def widen(self, rate_sigma: float) -> Solution:
        """Return the solution with the relative sigma of a nominal rate added to its position and distance sigmas.

        The path goes with the square of the period dT (force integrated twice), turns with the period unless the field
        shows them. For strides s after turns psi, with J the quarter turn,

            dp / (dT/T) = sum (2 s + psi J s).
        """
        if rate_sigma <= 0.0 or not len(self.stances):
            return self
        scale_sigma, table = 2.0 * rate_sigma, self.stances
        stride, turned = np.diff(table.position, axis=0), np.zeros(len(table))
        if self.graph.get("magnetic_heading", 0) <= 1:  # a single one fixes north alone, not the turns
            heading = np.unwrap(np.arctan2(table.nav_R_body[:, 1, 0], table.nav_R_body[:, 0, 0]))
            turned = rate_sigma * (heading - heading[0])
        sideways = turned[:-1, None] * stride[:, [1, 0, 2]] * [-1.0, 1.0, 0.0]
        move = scale_sigma * stride + sideways
        off = np.concatenate([np.zeros((1, 3)), np.cumsum(move, axis=0)])
        added = np.einsum("ki,kj->kij", off, off)
        heading_sigma = np.hypot(table.heading_sigma, turned)
        table = replace(table, position_cov=table.position_cov + added, heading_sigma=heading_sigma)
        if table.move_cov is not None:
            by_rate = np.pad(np.column_stack([move, np.diff(turned)]), ((1, 0), (0, 0)))
            table = replace(table, move_cov=table.move_cov + np.einsum("ki,kj->kij", by_rate, by_rate))
        of_distance = self.distance_sigma_m
        if of_distance is not None:
            walked = np.linalg.norm(stride[:, :2], axis=1).sum()
            of_distance = float(np.hypot(of_distance, scale_sigma * walked))
        return replace(self, stances=table, distance_sigma_m=of_distance)

    def to_dataframe(self, rows: Rows = "samples") -> pd.DataFrame:
        """Return the path, or the gait, as a table.

        Parameters
        ----------
        rows : "samples", "footfalls" or "strides"
            One row a sample, `SAMPLE_COLUMNS`: position (m) and velocity (m/s) in the navigation frame, heading of the
            body's x axis in [0, 360) deg clockwise from north, quaternion of `nav_R_body`. One row a footfall with its
            standard deviations, `STRIDE_COLUMNS`. Or one row a stride with its gait parameters,
            `fg_nav.gait.GAIT_COLUMNS`, of a sensor on a foot.

        Raises
        ------
        EstimationError
            For strides of a sensor in a pocket, or rows that are none of these.

        Examples
        --------
        >>> solution = fg_nav.navigate("walk.csv", "inertial")
        >>> solution.to_dataframe().columns[:4].tolist()
        ['time_s', 'x_m', 'y_m', 'z_m']
        >>> footfalls = solution.to_dataframe("footfalls")
        >>> bool(footfalls.sigma_x_m.iloc[-1] > footfalls.sigma_x_m.iloc[0])
        True
        >>> strides = solution.to_dataframe("strides")
        >>> bool(strides.length_m[strides.steady].mean() > 1.0)
        True
        """
        if rows == "strides":
            table: pd.DataFrame = fg_nav.tabulate_gait({"": self})
            return table
        if rows == "footfalls":
            return self.stances.to_dataframe()
        if rows != "samples":
            raise EstimationError(f"there are no rows '{rows}': choose one of {', '.join(get_args(Rows))}.")
        return tabulate_path(self.t, self.position, self.velocity, self.nav_R_body)

    def save(self, path: Path | str, force: bool = False, *, origin: Sequence[float] | None = None) -> Path:
        """Write the path, and return where it is.

        Parameters
        ----------
        path : Path or str
            Of a folder to make, for all that `fg-nav run` writes as far as it is known here, or of one file by its
            ending: `.geojson`, `.kml`, `.gpx`, `.tum`, `.mat`, `.parquet`, `.mcap` (ROS 2) or `.rrd` (Rerun).
        force : bool
            Replace an older result there.
        origin : latitude, longitude (deg) and, where known, height (m)
            Of where the foot first stood, for the first three.

        Raises
        ------
        OutputError
            If something is there already, it cannot be written, or nothing is written with this ending.

        Examples
        --------
        >>> solution = fg_nav.navigate("walk.csv", "inertial")
        >>> sorted(file.name for file in solution.save("mine").glob("*.csv"))
        ['gait.csv', 'strides.csv']
        >>> solution.save("mine.kml", origin=(48.137, 11.575)).stat().st_size > 0
        True
        """
        place: Path = fg_nav.save_solution(self, Path(path), force, origin)
        return place

    def plot(self, axes: Any = None) -> Any:
        """Draw the path from above, with the 95 % ellipses of its footfalls; return the `matplotlib.axes.Axes`.

        They are east and north, or x and y where north is not known. `axes` are those to draw into; without them a new
        figure of `matplotlib.pyplot` is made.

        Examples
        --------
        >>> axes = fg_nav.navigate("walk.csv", "inertial").plot()
        >>> axes.get_xlabel()
        'x (m)'
        """
        return fg_nav.plot_solution(self, axes)

    def _repr_html_(self) -> str:
        """Show its figures and its path in a notebook."""
        return str(fg_nav.render_solution(self))

    def __repr__(self) -> str:
        """Say in a line what it is; the arrays are many."""
        long = f"{len(self.t)} samples, {len(self.stances)} footfalls"
        return f"<{type(self).__name__} by {self.method}: {long}, ends at {self.position[-1].round(2).tolist()} m>"
