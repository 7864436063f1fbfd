"""What the verbs share: where an option applies, the options of a walk, the folder of a result, and answers."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from fg_nav.commands.requests import (
    PRESETS,
    BarometerOptions,
    FieldOptions,
    ReadingOptions,
    Request,
    SensorOptions,
    TruthOptions,
    WalkOptions,
)
from fg_nav.errors import EstimationError, FgNavError, FormatError, OutputError, RecordingError
from fg_nav.estimators import Method, Use, check_use
from fg_nav.report.folder import RESULT_FILES, claim_folder, fill_folder, hold_folder
from fg_nav.report.terminal import console, progress, remark, ruled_table
from fg_nav.text import to_json

if TYPE_CHECKING:
    from fg_nav.io import Reading
    from fg_nav.walk import Options, Outcome, Walk

RESULTS = Path("results")  # Where results go for which no folder was named.
MAX_SENTENCES = 5  # On recordings that failed; each has its own in the JSON.
PACKED = (".gz", ".zip", ".bz2", ".xz")
TRUTH = "truth.tum"  # A truth beside its recording, as `fg-nav simulate` leaves it.
SAME_SPAN_S = 0.5  # By which a truth and its recording, one of several, begin and end apart.
LOG = logging.getLogger(__name__)
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
    name = recording.name if recording.is_dir() else _unpacked(recording).stem
    if recording.is_dir() or not NAMELESS.fullmatch(re.sub("[ _-]", "", name)):
        return name
    return recording.resolve().parent.name or name


def name_truth(recording: Path) -> Path:
    """Return where the truth of a recording is that is one of several in a folder."""
    return recording.with_name(f"{_unpacked(recording).stem}.{TRUTH}")


def _unpacked(recording: Path) -> Path:
    """Return the path of what a packed file holds, or the path itself."""
    return recording.with_suffix("") if recording.suffix.lower() in PACKED else recording


def find_truth(walk: Walk, recording: Path) -> Walk:
    """Return the walk with the truth beside its recording, if it has none; a remark says so, or why it is not used.

    `NAME.truth.tum` is that of NAME. `truth.tum` is that of the only recording in its folder, and of several that of
    one which begins and ends with it.
    """
    from fg_nav.evaluation.comparison import share_truth
    from fg_nav.io import read_truth
    from fg_nav.truth import TrajectoryTruth, check_truth

    folder, named = recording if recording.is_dir() else recording.parent, name_truth(recording)
    file = named if named.is_file() else folder / TRUTH
    if walk.truth is not None or not file.is_file():
        return walk
    others = () if folder == recording else folder.glob(f"*{recording.suffix}")
    t, is_only = walk.recording.t, file == named or all(one.name == recording.name for one in others)
    try:
        truth = read_truth(file)
        if not isinstance(truth, TrajectoryTruth):
            raise FormatError(f"{file.name} is no path.")
        if not is_only and np.abs(truth.t[[0, -1]] - t[[0, -1]]).max() > SAME_SPAN_S:
            LOG.info(f"{file} does not begin and end with {recording.name}: it may be of another recording there")
            return walk
        check_truth(truth, t)
        share_truth(truth, t)
    except FgNavError as error:
        remark(f"note: {file}, beside the recording, is not used: {error}", logging.WARNING)
        return walk
    remark(f"note: {file}, beside the recording, is taken for its truth; --no-truth leaves it out")
    return replace(walk, truth=truth, options=replace(walk.options, truth_path=file))


@dataclass(frozen=True)
class Answer:
    """What a verb has to say."""

    content: object  # For scripts, as JSON (`fg_nav.text.to_json`).
    show: Callable[[], None]  # Prints it for people.
    failure: FgNavError | None = None  # Raised after that; None where nothing is amiss.


@dataclass
class Target:
    """The folder of a result, to be entered before the work: it is checked, and locked until the result is there."""

    out: Path | None  # That was named; None for a fresh one under `RESULTS`.
    force: bool  # Replace an older result in it.
    name: str  # Of the fresh one, without its number.
    ours: frozenset[str] = RESULT_FILES  # Files that may be replaced.

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


@dataclass(frozen=True)
class Applies:
    """Where an option makes sense."""

    mounts: tuple[str, ...] = ("foot", "feet", "pocket")  # Values of `--mount`.
    use: Use | None = None  # Of the method.
    one: bool = False  # Of a single recording.
    mag: bool = False  # Of a magnetometer that is used.


APPLIES: dict[str, Applies] = {
    "right": Applies(("feet",)),
    "sides": Applies(("feet",)),
    "clock_offset": Applies(("feet",)),
    "step_constant": Applies(("pocket",)),
    "known_distance": Applies(("pocket",), one=True),
    "gate": Applies(("foot", "feet"), "gate", mag=True),
    "magnetic": Applies(("foot", "feet"), "magnetic", mag=True),
    "preset": Applies(("foot", "feet"), "preset"),
    "settings": Applies(("foot", "feet")),
    "mag_axes": Applies(mag=True),
    "fixes": Applies(("foot",), "fixes", one=True),
    "gnss": Applies(("foot", "pocket"), "gnss", one=True),
    "places": Applies(("foot",), "places", mag=True),
    "save_places": Applies(("foot",), one=True, mag=True),
    "truth": Applies(one=True),
    "barometer": Applies(("foot", "pocket"), one=True),
    "config": Applies(("foot", "pocket")),
    "polish": Applies(("foot", "pocket"), "polish"),
    "lag": Applies(("foot",)),
    "resume": Applies(("foot", "pocket")),
    "record": Applies(("foot", "pocket")),
}
"""By the field of a request."""


def refuse_misfits(request: Request, methods: Sequence[Method] = (), recordings: int = 1) -> None:
    """Raise `EstimationError` for the first option of a request that does not fit its mount, methods or recordings."""
    from fg_nav.walk import OWN_GNSS  # of every recording its own

    mount, no_mag = getattr(request, "mount", None) or "foot", getattr(request, "no_mag", False)
    names = {"right": "a second source", "settings": "--set"}
    for item in fields(request):
        value, where = getattr(request, item.name), APPLIES.get(item.name)
        if where is None or value in (None, [], item.default):
            continue
        option = names.get(item.name, f"--{item.name.replace('_', '-')}")
        if mount not in where.mounts:
            there, add = " or ".join(where.mounts), "add that, or " if mount == "foot" else ""
            if item.name == "fixes" and mount == "pocket" and hasattr(request, "gnss"):
                add = "give positions of a receiver with --gnss, or "
            raise EstimationError(f"{option} is for --mount {there}: {add}leave {option} out.")
        if no_mag and where.mag:
            raise EstimationError(f"{option} is for the magnetic field: leave {option} out with --no-mag.")
        if where.one and recordings > 1 and mount != "feet" and value != OWN_GNSS:
            raise EstimationError(f"{option} is of one recording: give the {recordings} one by one.")
        if where.use is not None and methods and not any(where.use in one.uses for one in methods):
            check_use(methods[0], where.use)


def choose_options(request: SensorOptions) -> Options:
    """Return the options of a walk; refuse an unknown preset or gate."""
    from fg_nav.magnetic.axes import MagAxes
    from fg_nav.magnetic.detectors import choose_gate
    from fg_nav.walk import Options

    options = Options(
        heading_deg=request.heading,
        calibration_path=request.calibration,
        mag_axes=None if request.mag_axes is None else MagAxes.parse(request.mag_axes),
    )
    if isinstance(request, TruthOptions):
        options = replace(options, truth_path=request.truth, alignment=request.alignment)
    if isinstance(request, FieldOptions):
        options = replace(options, use_magnetometer=not request.no_mag, gate=choose_gate(request.gate))
    if isinstance(request, WalkOptions):
        if request.preset != PRESETS[0]:  # the others load all filters
            from fg_nav.ekf.presets import check_preset

            check_preset(request.preset)
        options = replace(options, preset=request.preset)
    return options


def choose_reading(request: ReadingOptions) -> Reading:
    """Return how to read a file whose content leaves it open; raises `FormatError` for an invalid rate."""
    from fg_nav.columns.mapping import parse_columns
    from fg_nav.io import Reading
    from fg_nav.recording import NOMINAL_SIGMA

    reading = Reading(
        request.format,
        None if request.columns is None else parse_columns(request.columns),
        None,
        request.sensor,
        barometer=request.barometer if isinstance(request, BarometerOptions) else None,
    )
    if request.rate is None:
        return reading
    hertz, _, sigma = request.rate.replace("±", "+-").partition("+-")
    try:
        rate_hz, share = float(hertz), float(sigma) / float(hertz) if sigma else NOMINAL_SIGMA
    except (ValueError, ZeroDivisionError):
        raise FormatError(
            f"a rate of {request.rate} Hz is none: give samples a second, such as 200 or 200+-0.1."
        ) from None
    return replace(reading, rate_hz=rate_hz, rate_sigma=abs(share))


def split_files(option: str, files: Path | None) -> tuple[Path | None, Path | None]:
    """Return the two files of `A,B`, one for each foot's recording; (None, None) if `files` is None."""
    if files is None:
        return None, None
    first, _, second = str(files).partition(",")
    if not (first and second) or "," in second:
        raise EstimationError(
            f"{option} {files} is of one recording: with --mount feet give two files, one for each recording in their "
            f"order, as {option} A,B."
        )
    return Path(first), Path(second)


def run_methods(walk: Walk, methods: Sequence[str]) -> dict[str, Outcome]:
    """Run each method on a walk, with a bar on the terminal."""
    from fg_nav.pipeline import run_method

    outcomes = {}
    for method in methods:
        with progress(method) as report:
            outcomes[method] = run_method(walk, method, report)
    return outcomes


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

    def show() -> None:
        table = ruled_table("recording", *columns)
        for content in contents:
            known = len(content.keys() - {"recording", "error"}) > 0
            cells = [cell(content) for cell in columns.values()] if known else ["failed", *([""] * (len(columns) - 1))]
            table.add_row(content["recording"], *cells)
        console().print(table)

    if not sentences:
        return Answer(contents, show)
    more = len(sentences) - MAX_SENTENCES
    said = " ".join([*sentences[:MAX_SENTENCES], *([f"And {more} more."] if more > 0 else [])])
    return Answer(contents, show, RecordingError(f"{len(sentences)} of {len(recordings)} recordings failed. {said}"))


def show_number(key: str, pattern: str) -> Callable[[Mapping[str, Any]], str]:
    """Return what writes a number of a content; a dash where it is not known."""
    return lambda content: "-" if content.get(key) is None else pattern.format(content[key])
