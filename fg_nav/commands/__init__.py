"""The verbs of the command line, a page each, and what they share: their options, and the folder of a result.

Each verb checks what it can before the work, works, writes into a folder that appears whole or not at all, and returns
an `Answer`, which the command line prints.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from fg_nav.errors import FgNavError, FormatError, MagneticError, OutputError, RecordingError, SimulationError
from fg_nav.report.folder import RESULT_FILES, claim_folder, fill_folder, hold_folder
from fg_nav.report.terminal import console, progress, ruled_table
from fg_nav.text import to_json

if TYPE_CHECKING:
    from fg_nav.changes import Changes
    from fg_nav.earth import EarthField
    from fg_nav.io import Reading
    from fg_nav.lab.simulation import Choices
    from fg_nav.walk import Magnetic, Options, Outcome, Walk

Simulated = TypeVar("Simulated")

RESULTS = Path("results")  # Where results go for which no folder was named.
TUNED = "tuned"  # The preset of the filters that needs no check: the others load them all.
MAX_SENTENCES = 5  # On recordings that failed; each has its own in the JSON.
PACKED = (".gz", ".zip", ".bz2", ".xz")
NAMELESS = re.compile(  # Names of files that say what is in them and not which walk it is: their folder says that.
    "recording|record|(raw)?data|samples|sensors?|imu|log|export"
    "|(total|linear)?acc(el|eleration|elerometer)?(uncalibrated)?|gyr(o|oscope)?(uncalibrated)?"
    "|mag(neticfield|netometer)?(uncalibrated)?",
    re.IGNORECASE,
)

Columns: TypeAlias = Mapping[str, Callable[[Mapping[str, Any]], str]]
"""Heads of a table of several recordings, and what stands below each by the content of an answer."""


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
    """Return the options of a walk; refuse an unknown preset or gate, and a gate without a magnetometer to judge."""
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
    """Return how to read a file whose content leaves it open; raises `FormatError` for an invalid rate."""
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


def simulate_named(
    simulate: Callable[..., Simulated], name: str, seed: int, choices: Choices | None = None
) -> Simulated:
    """Simulate one foot or both of a scenario by its name, or that of a file, with a bar on the terminal."""
    from fg_nav.lab.simulation import Choices, scenario
    from fg_nav.lab.simulation.scenario_file import SUFFIX, read_scenario

    own = name.endswith(SUFFIX)
    chosen = read_scenario(Path(name)) if own else scenario(name)
    try:
        with progress(chosen.name) as report:
            return simulate(chosen, seed, choices or Choices(), progress=report)
    except SimulationError as error:
        raise SimulationError(f"{Path(name).name}: {error}" if own else str(error)) from None


def answer_each(recordings: Sequence[Path], verb: Callable[[Path], Answer], columns: Columns) -> Answer:
    """Run a verb on each recording and return one answer, a table with a row each; a failure does not stop the rest.

    The `failure` of the answer names the recordings that failed.
    """
    contents, sentences = [], []
    for recording in recordings:
        content: dict[str, Any] = {"recording": str(recording)}
        failure: Exception | None = None
        try:
            answer = verb(recording)
            content, failure = to_json(answer.content), answer.failure
        except (FgNavError, OSError) as error:
            failure = error
        if failure is not None:
            content["error"] = " ".join(str(failure).split())
            named = recording.name in content["error"]
            sentences.append(content["error"] if named else f"{recording}: {content['error']}")
        contents.append(content)
    show = partial(print_table, contents, columns)
    if not sentences:
        return Answer(contents, show)
    more = len(sentences) - MAX_SENTENCES
    said = " ".join([*sentences[:MAX_SENTENCES], *([f"And {more} more."] if more > 0 else [])])
    return Answer(contents, show, RecordingError(f"{len(sentences)} of {len(recordings)} recordings failed. {said}"))


def print_table(contents: Sequence[Mapping[str, Any]], columns: Columns) -> None:
    """Print one row a recording; where there is nothing to say of it, that it failed."""
    table = ruled_table("recording", *columns)
    for content in contents:
        known = len(content.keys() - {"recording", "error"}) > 0
        cells = [cell(content) for cell in columns.values()] if known else ["failed", *([""] * (len(columns) - 1))]
        table.add_row(content["recording"], *cells)
    console().print(table)


def show_number(key: str, pattern: str) -> Callable[[Mapping[str, Any]], str]:
    """Return what writes a number of a content; a dash where it is not known."""
    return lambda content: "-" if content.get(key) is None else pattern.format(content[key])
