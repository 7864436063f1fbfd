"""The verbs of the command line, a page each, and what they share: their options, and the folder of a result.

Each verb checks what it can before the work, works, writes into a folder that appears whole or not at all, and returns
an `Answer`, which the command line prints.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from fg_nav.errors import FormatError, MagneticError, OutputError, SimulationError
from fg_nav.report.folder import RESULT_FILES, claim_folder, fill_folder, hold_folder
from fg_nav.report.terminal import progress

if TYPE_CHECKING:
    from fg_nav.changes import Changes
    from fg_nav.earth import EarthField
    from fg_nav.errors import FgNavError
    from fg_nav.io import Reading
    from fg_nav.lab.simulation import Choices, SimulatedFeet, SimulatedWalk
    from fg_nav.walk import Magnetic, Options, Outcome, Walk

Simulated = TypeVar("Simulated")

RESULTS = Path("results")  # Where results go for which no folder was named.
TUNED = "tuned"  # The preset of the filters that needs no check: the others load them all.


NAMELESS = re.compile(
    "recording|record|(raw)?data|samples|sensors?|imu|log|export"
    "|(total|linear)?acc(el|eleration|elerometer)?(uncalibrated)?|gyr(o|oscope)?(uncalibrated)?"
    "|mag(neticfield|netometer)?(uncalibrated)?",
    re.IGNORECASE,
)
"""Names of files that say what is in them and not which walk it is: that stands in the name of their folder."""

PACKED = (".gz", ".zip", ".bz2", ".xz")


def name_walk(recording: Path) -> str:
    """Return the name of a recording for its results: that of the file, or of the folder of a `recording.csv`."""
    packed = recording.suffix.lower() in PACKED
    inner = recording.with_suffix("") if packed else recording
    name = recording.name if recording.is_dir() else inner.stem
    if recording.is_dir() or not NAMELESS.fullmatch(re.sub("[ _-]", "", name)):
        return name
    return recording.resolve().parent.name or name


@dataclass(frozen=True)
class Answer:
    """What a verb has to say.

    Attributes
    ----------
    content : for scripts, as JSON (`fg_nav.text.to_json`).
    show : prints it for people.
    failure : raised after that; None where nothing is amiss.
    """

    content: object
    show: Callable[[], None]
    failure: FgNavError | None = None


@dataclass
class Target:
    """The folder of a result, to be entered before the work: it is checked, and locked until the result is there.

    Attributes
    ----------
    out : the folder that was named; None for a fresh one under `RESULTS`.
    force : replace an older result in it.
    name : of the fresh one, without its number.
    ours : file names that may be replaced.
    """

    out: Path | None
    force: bool
    name: str
    ours: frozenset[str] = RESULT_FILES

    def __enter__(self) -> Target:
        self._held = ExitStack()
        if self.out is not None:
            self._held.enter_context(hold_folder(self.out, self.force, self.ours))
        elif self.force:
            raise OutputError("--force replaces the result in a folder: name the folder with --out.")
        return self

    def __exit__(self, *raised: object) -> None:
        self._held.close()

    @property
    def place(self) -> Path:
        """Where the result is, once the folder is open."""
        assert self.out is not None
        return self.out

    @contextmanager
    def open(self) -> Iterator[Path]:
        """Yield the folder to write into; at the end of the block its content becomes that of `place`."""
        if self.out is None:
            self.out = self._held.enter_context(claim_folder(RESULTS, self.name))
        with fill_folder(self.out, self.force, self.ours) as folder:
            yield folder


def choose_options(
    use_magnetometer: bool = True,
    heading_deg: float | None = None,
    alignment: str = "yaw",
    truth: Path | None = None,
    gate: str | None = None,
    calibration: Path | None = None,
    preset: str = TUNED,
    fixes: Path | None = None,
    mag_axes: str | None = None,
    polish: bool = False,
    changes: Changes = (),
    places: Path | None = None,
    magnetic: Magnetic = "all",
    gnss: Path | None = None,
) -> Options:
    """Return the options of a walk; refuse a preset or a gate that there is not, or that has nothing to judge."""
    from fg_nav.magnetic.axes import MagAxes
    from fg_nav.magnetic.quasi_static import choose_gate
    from fg_nav.walk import Options

    chosen = choose_gate(gate, use_magnetometer)
    if preset != TUNED:
        from fg_nav.ekf.presets import check_preset

        check_preset(preset)
    if not use_magnetometer and mag_axes is not None:
        raise MagneticError("--no-mag leaves --mag-axes nothing to turn: give one of them.")
    if not use_magnetometer and magnetic != "all":
        raise MagneticError("--no-mag leaves --magnetic no factors: give one of them.")
    given = (use_magnetometer, heading_deg, alignment, truth, chosen, magnetic, calibration, preset, fixes)
    axes = None if mag_axes is None else MagAxes.parse(mag_axes)
    return Options(*given, changes=changes, mag_axes=axes, polish=polish, places_path=places, gnss_path=gnss)


def choose_reading(
    format: str | None, columns: str | None, rate: str | None, sensor: str | None, barometer: Path | None = None
) -> Reading:
    """Return how a file is to be read where its content does not say; raises `FormatError` for a rate that is none."""
    from fg_nav.columns.mapping import parse_columns
    from fg_nav.io import Reading
    from fg_nav.recording import NOMINAL_SIGMA

    mapping = None if columns is None else parse_columns(columns)
    if rate is None:
        return Reading(format, mapping, None, sensor, barometer=barometer)
    hertz, _, sigma = rate.replace("±", "+-").partition("+-")
    try:
        rate_hz, share = float(hertz), float(sigma) / float(hertz) if sigma else NOMINAL_SIGMA
    except (ValueError, ZeroDivisionError):
        raise FormatError(f"a rate of {rate} Hz is none: give samples a second, such as 200 or 200+-0.1.") from None
    return Reading(format, mapping, rate_hz, sensor, rate_sigma=abs(share), barometer=barometer)


def find_earth_field(place: str | None) -> EarthField | None:
    """Return the Earth's field at a place and date in words; None where they were not given."""
    if place is None:
        return None
    from fg_nav.earth import Place, compute_field

    return compute_field(Place.parse(place))


def run_methods(walk: Walk, methods: Sequence[str]) -> dict[str, Outcome]:
    """Run each method on a walk, with a bar on the terminal."""
    from fg_nav.pipeline import run_method

    outcomes = {}
    for method in methods:
        with progress(method) as report:
            outcomes[method] = run_method(walk, method, report)
    return outcomes


def simulate_walk(name: str, seed: int, choices: Choices | None = None) -> SimulatedWalk:
    """Simulate a scenario by its name, or that of a file, with a bar on the terminal."""
    from fg_nav.lab.simulation import simulate

    return _simulate_named(simulate, name, seed, choices)


def simulate_both_feet(name: str, seed: int, choices: Choices | None = None) -> SimulatedFeet:
    """Simulate both feet, as `simulate_walk` does one."""
    from fg_nav.lab.simulation import simulate_feet

    return _simulate_named(simulate_feet, name, seed, choices)


def _simulate_named(simulate: Callable[..., Simulated], name: str, seed: int, choices: Choices | None) -> Simulated:
    from fg_nav.lab.simulation import Choices, scenario
    from fg_nav.lab.simulation.scenario_file import SUFFIX, read_scenario

    own = name.endswith(SUFFIX)
    chosen = read_scenario(Path(name)) if own else scenario(name)
    try:
        with progress(chosen.name) as report:
            return simulate(chosen, seed, choices or Choices(), progress=report)
    except SimulationError as error:
        raise SimulationError(f"{Path(name).name}: {error}" if own else str(error)) from None
