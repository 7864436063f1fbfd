"""Cases of the fuzz campaign: an input of a kind, the command that is given it, and what is held against its answer.

A case is drawn from its seed, kind and number alone, and run by the command line's own entry point in this process,
in a folder of its own. What it must do:

========== ===========================================================================================================
refused    exit code 1, one sentence, and no result left behind
accepted   exit code 0; all numbers finite, stamps rising, sigmas above zero and growing where samples are lost
never      another exit code, a traceback, a warning of Python's, or a path faster than `MAX_M_S` or with a stride
           over `MAX_STRIDE_M` that is neither called "not to be used" nor doubtful with a reason that names it
========== ===========================================================================================================
"""

from __future__ import annotations

import io
import json
import os
import shutil
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from fuzz import mutations as wrong
from fuzz.mutations import Rng, draw

from fg_nav import cli
from fg_nav.arrays import Floats
from fg_nav.columns.mapping import CANONICAL
from fg_nav.errors import RecordingError
from fg_nav.io import read
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.online.buffer import rows_of
from fg_nav.online.record import LINES
from fg_nav.recording import RawRecording
from fg_nav.samples.intake import Intake
from fg_nav.verdict import UNUSABLE

sys.path.append(str(Path(__file__).resolve().parents[2]))  # the tests have a writer for each format

Words: TypeAlias = list[str]


@dataclass(frozen=True)
class Case:
    """One input: `seed`, `kind` and `number` are all that it is drawn from."""

    kind: str
    seed: int
    number: int


@dataclass
class Fate:
    """What became of a case: refused with the sentence `said`, or accepted with that verdict; seconds of processor."""

    case: Case
    what: str = ""
    command: str = ""
    outcome: str = ""
    said: str = ""
    faults: Words = field(default_factory=list)
    seconds: float = 0.0


@dataclass
class Input:
    """A command, what was done to its input, standard input, and from when to when samples are lost, s."""

    words: Words
    what: str
    stdin: bytes | None = None
    lost: tuple[float, float] | None = None


# --- clean inputs ----------------------------------------------------------------------------------------------------

MAX_S, REAL_BYTES = 90.0, 1_500_000  # of a recording from which pieces are cut; of a real binary file
REAL = (
    "gdin/own_obsolete/SensorConnectData_15.csv", "gdin/own/SensorConnectData_31.csv", "vicon/2017-11-22-11-26-05.mat",
    "gdin/own/SensorConnectData_43.csv", "gdlbio/SensorConnectData_52_GDLBIO.mat", "vicon/2017-11-27-11-14-52.mat",
    "openshoe/data_inert13.txt", "xio/short_walk.csv", "ridi_leg/zhicheng_leg2.csv", "broad/24_disturbed_tapping_A.mat",
)  # fmt: skip
SIMULATED = ("demo", "office", "mixed-gait", "pocket-street")
IN_POCKET = ("pocket", "ridi")  # how the names of those in a pocket begin
SCENARIO = """like = "office"
field = "smooth"
rests = "none"
magnets = [[1.5, 10.0, 0.0]]
course = {points_m = [[0, 0], [0, 7], [6, 7]], corner_radius_m = 1.2, laps = 1, rest_s = 2.0, pace = 1.0, run = false}
sensor = {rate_hz = 100, gyr = {noise_density = 1e-4}}
"""
CONFIGURED = ("smoother", "iez", "qsf", "online")  # methods whose config.json is damaged
GRAPHS = ("smoother", "inertial", "online")  # methods that take known positions


class Store:
    """Clean inputs in a folder that all workers share; `data` holds the real recordings, None where there are none."""

    def __init__(self, folder: Path, data: Path | None) -> None:
        self.folder, self.data = folder, data
        self.recordings = [*SIMULATED, *(name for name in REAL if data is not None and (data / name).exists())]

    def rows(self, name: str) -> Floats:
        """Return the beginning of a recording as rows (n, 10) of t, acc, gyr, mag; stored by who needs it first."""
        path = self.folder / f"{name.replace('/', '_')}.npy"
        if not path.exists():
            simulated = simulate(SCENARIOS[name], 1, Choices(rate_hz=100.0)) if name in SIMULATED else None
            recording = simulated.recording if simulated else read((self.data or Path()) / name)
            last = int(np.searchsorted(recording.t, recording.t[0] + MAX_S))
            with tempfile.NamedTemporaryFile(dir=self.folder, delete=False) as fresh:
                np.save(fresh, rows_of(recording.slice(0, last))[:, :10])
            os.replace(fresh.name, path)  # whole, whoever else makes it
        return np.asarray(np.load(path))

    def make_companions(self) -> None:
        """Write walks of 16 s, on a foot and in a pocket, and what goes with them, by the commands that write it."""
        folder = self.folder
        for name, more in (("walk", ""), ("pocket", "--worn pocket")):
            self._run(f"simulate demo --rate 100 {more} --force --out {name}")
            header, *rows = (folder / name / "recording.csv").read_text().splitlines(keepends=True)
            for end, of in (("", rows[:1600]), ("-begin", rows[:1200]), ("-rest", rows[1100:1600])):
                (folder / f"{name}{end}.csv").write_text("".join([header, *of]))
        truth = np.loadtxt(shutil.copy(folder / "walk" / "truth.tum", folder))
        steps = [f"{k},{x:.3f},{y:.3f}" for k, (x, y) in enumerate(truth[:930:93, 1:3])]
        fixes = [f"{t:.2f},{x:.2f},{y:.2f},,0.3" for t, x, y in truth[300:1500:200, :3] - [0.0, *truth[0, 1:3]]]
        (folder / "footprints.csv").write_text("\n".join(["stride,x_m,y_m", *steps, ""]))
        (folder / "fixes.csv").write_text("\n".join(["time_s,x_m,y_m,z_m,sigma_m", *fixes, ""]))
        (folder / "scenario.toml").write_text(SCENARIO)
        self._run("calibrate walk/recording.csv --force --out sensor.json")
        for method in CONFIGURED:
            self._run(f"run walk.csv --method {method} --heading 10 --plots none --force --out {method}")
            shutil.copy(folder / method / "config.json", folder / f"{method}.json")
        for words in ("foot", "lagged --lag 12", "thigh --mount pocket"):
            begin = (folder / f"{'pocket' if 'pocket' in words else 'walk'}-begin.csv").read_bytes()
            self._run(f"stream - --plots none --force --out out --record {words}", begin)

    def _run(self, words: str, stdin: bytes | None = None) -> None:
        code, _, err = call([*words.split(), "--quiet"], self.folder, stdin)
        assert code == 0, err


# --- recordings ------------------------------------------------------------------------------------------------------

METHODS = (
    *("smoother",) * 6, "inertial", "iez", "iez", "iez-rts", "online", "qsf", "iqsf-rts", "ma2018", "aiez", "matched",
)  # fmt: skip
FORMAT_NAMES = ("canonical", "table", "xio", "pyshoe", "openshoe", "sensorlog", "xsens-dot", "ros")


def cut_piece(store: Store, rng: Rng) -> tuple[Floats, str]:
    """Cut 3 to 10 s, of one in twenty up to 25 s, out of a recording; its rows and its name."""
    name, longest_s = draw(rng, store.recordings), 25.0 if rng.random() < 0.05 else 10.0
    rows, duration_s = store.rows(name), float(np.exp(rng.uniform(np.log(3.0), np.log(longest_s))))
    start = rng.uniform(rows[0, 0], max(rows[0, 0], rows[-1, 0] - duration_s))
    return rows[(rows[:, 0] >= start) & (rows[:, 0] < start + duration_s)], name


def choose_method(rng: Rng, name: str) -> Words:
    """Draw a method, mostly one that fits the recording of this name, and options."""
    words = ["--plots", "none" if rng.random() < 0.95 else "html"]
    if rng.random() < (0.85 if name.startswith(IN_POCKET) else 0.03):
        words += ["--mount", "pocket", "--method", draw(rng, ("pocket", "munoz-diaz2017", "online"))]
    else:
        words += ["--method", draw(rng, METHODS)]
    return [*words, *draw(rng, ([], [], [], [], ["--no-mag"], [f"--heading={draw(rng, ('0', '-7200', '1e9'))}"]))]


def write_rows(rows: Floats, path: Path) -> Path:
    """Write canonical rows, whatever they hold."""
    lines = (",".join(map(repr, row)).replace("nan", "") for row in rows.tolist())
    path.write_text("\n".join([",".join(CANONICAL[:10]), *lines, ""]))
    return path


def damage(path: Path, rng: Rng) -> str:
    """Damage a file in place: its bytes, of a text its rows, fields and numbers, of JSON its tree; in words how."""
    data = path.read_bytes()
    kind = draw(rng, ("bytes", "bytes", "table", "numbers", "varied")) if b"\0" not in data[:1000] else "bytes"
    if path.suffix == ".json" and data.rstrip().endswith((b"}", b"]")) and rng.random() < 0.8:
        kind, breaks = "tree", rng.random() < 0.4
        data = json.dumps(wrong.change_tree(json.loads(data), rng, breaks)).encode("utf-8", "replace")
    elif kind == "bytes":
        data, kind = wrong.mutate_bytes(data, rng)
    else:
        text = data.decode("utf-8", "surrogateescape")
        changes = {"table": wrong.scramble_table, "varied": wrong.vary_table, "numbers": wrong.change_numbers}
        data = changes[kind](text, rng, max(",;\t ", key=text[:2000].count)).encode("utf-8", "surrogateescape")
    path.write_bytes(data)
    return kind


def make_samples(store: Store, rng: Rng, folder: Path) -> Input:
    """Samples that are wrong, in a canonical file."""
    piece, name = cut_piece(store, rng)
    rows, what = wrong.mutate_samples(piece, rng)
    write_rows(rows, folder / "walk.csv")
    return Input(["run", "walk.csv", *choose_method(rng, name)], f"{name}: {what}")


def make_format(store: Store, rng: Rng, folder: Path) -> Input:
    """A file in one of the formats, damaged as bytes or as a table."""
    from tests.io.every_format import SAMPLES

    rows, name = cut_piece(store, rng)
    mag = np.tile([20.0, 0.0, -43.0], (len(rows), 1)) if np.isnan(rows[:, 7:]).all() else rows[:, 7:]
    raw = RawRecording(rows[:, 0], rows[:, 1:4], rows[:, 4:7], np.arange(2, len(rows) + 2), mag=mag)
    kind = draw(rng, sorted(SAMPLES))
    path = SAMPLES[kind].write(raw, folder)
    what = damage(draw(rng, list_files(path)), rng)
    more = ["--format", draw(rng, FORMAT_NAMES)] if rng.random() < 0.1 else []
    return Input(["run", path.name, *more, *choose_method(rng, name)], f"{kind} of {name}: {what}")


def list_files(source: Path) -> list[Path]:
    """List a file, or those of a folder."""
    return [path for path in sorted(source.rglob("*")) if path.is_file()] if source.is_dir() else [source]


@cache
def list_real(data: Path) -> list[Path]:
    """List files that may be recordings, and folders that hold one in several files."""
    files = [path for path in list_files(data) if path.suffix not in (".md", ".tsv") and "LICENSE" not in path.name]
    folders = [path for path in (data / "formats").rglob("*") if path.is_dir() and 1 < len(list_files(path)) < 10]
    return [*sorted(folders), *(path for path in files if path.suffix != ".mat" or path.stat().st_size < REAL_BYTES)]


def make_real(store: Store, rng: Rng, folder: Path) -> Input:
    """A real file, or a folder of files that belong together, one of them damaged."""
    if store.data is None:
        return make_format(store, rng, folder)
    source, copies = draw(rng, list_real(store.data)), []
    for path in list_files(source):
        data, copy = path.read_bytes(), folder / path.relative_to(source.parent)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(data if b"\0" in data[:4000] else data[: draw(rng, (20_000, 200_000, 600_000))])
        copies.append(copy)
    target, name = draw(rng, copies), source.relative_to(store.data).as_posix()
    return Input(["run", source.name, *choose_method(rng, name)], f"{name}: {target.name}: {damage(target, rng)}")


def make_stream(store: Store, rng: Rng, folder: Path) -> Input:
    """Rows on standard input: wrong samples, wrong text, or both; or losses alone, which must show in the sigmas."""
    rows, name = cut_piece(store, rng)
    what = kind = draw(rng, ("samples", "text", "both", "losses"))
    if kind != "text":
        rows, what = wrong.mutate_samples(rows, rng, wrong.DEFECTS if kind == "losses" else wrong.SAMPLE_MUTATIONS)
    path = write_rows(rows, folder / "rows")
    if kind in ("text", "both"):
        what += f", {damage(path, rng)}"
    mount = ["--mount", "pocket"] if name.startswith(IN_POCKET) else draw(rng, ([], [], ["--lag", "10"]))
    more = draw(rng, ([], [], [], [], ["--no-mag"], ["--polish"], ["--heading=90"], ["--record=record.csv"]))
    given = Input(["stream", "-", "--plots", "none", *mount, *more], f"{name}: {what}", path.read_bytes())
    if kind == "losses" and "pocket" not in mount:
        t = np.zeros(0)
        with suppress(RecordingError):  # refused, as the program must
            t = Intake().push(np.column_stack([rows, np.full(len(rows), np.nan)]), at_end=True)[:, 0]
        k = int(np.argmax(np.diff(t))) if len(t) > 1 else 0
        given.lost = (float(t[k]), float(t[k + 1])) if len(t) > 1 else None
    return given


# --- companions and options ------------------------------------------------------------------------------------------

COMPANIONS: Mapping[str, Sequence[str]] = {
    "record": (
        f"stream - --record foot --resume --plots none < walk-rest.csv : foot foot{LINES} foot{LINES}",
        f"stream - --record lagged --resume --plots none --lag 12 < walk-rest.csv : lagged lagged{LINES}",
        f"stream - --record thigh --resume --plots none --mount pocket < pocket-rest.csv : thigh thigh{LINES}",
    ),
    "truth": tuple(
        f"run walk.csv --plots none --truth {name} --method {method} --alignment {alignment} : {name}"
        for name in ("truth.tum", "footprints.csv")
        for method, alignment in (("iez", "yaw"), ("smoother", "none"), ("iez", "origin"), ("iez", "se3"))
    ),
    "fixes": tuple(f"run walk.csv --plots none --fixes fixes.csv --method {m} : fixes.csv" for m in GRAPHS),
    "calibration": ("run walk.csv --plots none --calibration sensor.json --method iez : sensor.json",),
    "config": tuple(f"run walk.csv --plots none --config {method}.json : {method}.json" for method in CONFIGURED),
    "scenario": ("simulate scenario.toml --seed 1 : scenario.toml",),
}
"""Commands on clean files, and behind the colon those of which one is damaged."""


def make_companion(commands: Sequence[str], store: Store, rng: Rng, folder: Path) -> Input:
    """A command on clean files, of which one is damaged."""
    command, _, damaged = draw(rng, commands).partition(" : ")
    command, _, stdin = command.partition(" < ")
    for name in {*command.split(), *damaged.split()}:
        if (store.folder / name).is_file():
            shutil.copy(store.folder / name, folder)
    target = folder / draw(rng, damaged.split())
    what = f"{target.name}: {damage(target, rng)}"
    return Input(command.split(), what, (store.folder / stdin).read_bytes() if stdin else None)


CONFIGS: Mapping[str, bytes] = {
    "nested.json": b"[" * 100_000 + b"]" * 100_000,
    "deep.json": b'{"parameters": ' * 900 + b"1" + b"}" * 900,
    "huge.json": b'{"method": "smoother", "parameters": {"smoother": {"acc_density": 1' + b"0" * 5000 + b"}}}",
}
OPTIONS: Mapping[str, str] = {
    **dict.fromkeys(
        ("--heading", "--rate", "--known-distance", "--step-constant"),
        f"nan inf -inf 1e300 -1e300 0 -1 1e-300 x 45 {'9' * 400}",
    ),
    **dict.fromkeys(
        ("--fixes", "--truth", "--calibration", "--config"),
        f"missing.csv . walk.csv /dev/null /dev/zero /proc/self/mem {' '.join(CONFIGS)}",
    ),
    "--mag-axes": f"x,y,z x,x,z -y,x,z x,y ,, --x,y,z x,y,z,x X,Y,Z x,y,- +x,+y,+z \u2212x,y,z 1,2,3 {'x,y,z' * 1000}",
    "--columns": "time=1,acc=2:3:4,gyr=5:6:7 acc=2 time=1[ms],acc=2:3:4[g],gyr=5:6:7[deg/s] = time=99 a=b=c [ time=\0 "
    "time=1,acc=2:2:2,gyr=5:6:7 time=-1,acc=0:0:0,gyr=5:6:7 time=time_s[parsec] acc=2:3:4,gyr=5:6:7 acc=acc:acc:acc "
    f"time=1,acc=2:3:4,gyr=5:6:7,mag=8:9:10[gauss] time=1,acc=5:6:7,gyr=2:3:4 {',' * 5000} {'x' * 10_000}",
    "--set": "smoother.magnetic.rounds=-1 smoother.node_spacing_s=0 smoother.node_spacing_s=1e300 x=1 smoother iez.x=1 "
    "smoother.gravity=nan smoother.acc_density=0 smoother.acc_density=1e-300 smoother.gyr_density_deg_s=1e300 = "
    "smoother.magnetic=3 detector.threshold=0 detector.threshold=-1 detector.window_s=0 detector.window_s=1e9",
    "--format": "canonical table pyshoe ros x",
    "--gate": "qsf none x",
    "--preset": "tuned physical as-printed x",
    "--sensor": "x \0",
    "--mount": "pocket foot x",
}
"""Words for options, most of which cannot be meant; each may be empty too."""


def make_options(store: Store, rng: Rng, folder: Path) -> Input:
    """Words of the command line that cannot be meant, and files for them."""
    shutil.copy(store.folder / "walk.csv", folder)
    for name, content in CONFIGS.items():
        (folder / name).write_bytes(content)
    words = ["--method", draw(rng, ("smoother", "iez", "online"))]
    words += [f"{name}={draw(rng, ['', *OPTIONS[name].split(' ')])}" for name in rng.choice(list(OPTIONS), 2)]
    return Input(["run", "walk.csv", "--plots", "none", *words], " ".join(words)[:200])


KINDS: Mapping[str, tuple[int, Callable[[Store, Rng, Path], Input]]] = {
    "samples": (35, make_samples),
    "format": (16, make_format),
    "real": (7, make_real),
    "stream": (12, make_stream),
    **{kind: (9 if kind == "record" else 4, partial(make_companion, of)) for kind, of in COMPANIONS.items()},
    "options": (3, make_options),
}
"""Share of the campaign, and what makes an input."""

# --- running and judging ---------------------------------------------------------------------------------------------

MAX_M_S, MAX_STRIDE_M = 12.0, 4.0  # beyond these a path is no walk, and must be called not to be used
SPEED_S = 0.1  # over which a speed is measured: a causal filter moves its path at once at a footfall
LOST_S, GROWTH_M_S = 1.0, 0.05  # a loss that must show in the height's sigma, and by how much a second, in quadrature
USAGE = 2  # exit code of words that the command line does not understand


def run_case(store: Store, case: Case, keep: Path | None = None) -> Fate:
    """Draw a case, run it, and judge its answer; its folder is kept where that is asked for."""
    fate, rng = Fate(case), np.random.default_rng([case.seed, zlib.crc32(case.kind.encode()), case.number])
    folder = Path(tempfile.mkdtemp(prefix="fg-nav-fuzz-")) if keep is None else keep
    folder.mkdir(exist_ok=True)
    try:
        given = KINDS[case.kind][1](store, rng, folder)
        given.words += ["--out", "out"]
        fate.what, fate.command = given.what, " ".join(["fg-nav", *given.words])
        began = time.process_time()
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            answer = call(given.words, folder, given.stdin)
        fate.seconds = time.process_time() - began
        places = {f"{one.category.__name__}: {one.message} [{one.filename}:{one.lineno}]" for one in warned}
        fate.faults = [*sorted(f"warning: {place}" for place in places), *judge_answer(fate, *answer, folder, given)]
    finally:
        if keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    return fate


def call(words: Words, folder: Path, stdin: bytes | None = None) -> tuple[int, str, str]:
    """Call the entry point of the command line in a folder; its exit code and what it printed."""
    out, err, before = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO(), (Path.cwd(), sys.argv, sys.stdin)
    os.chdir(folder)
    sys.argv = ["fg-nav", *words]
    with ExitStack() as opened:
        opened.enter_context(redirect_stdout(out))
        opened.enter_context(redirect_stderr(err))
        if stdin is not None:
            Path("stdin").write_bytes(stdin)
            sys.stdin = opened.enter_context(open("stdin"))
        try:
            cli.main()
        except SystemExit as left:
            code = left.code if isinstance(left.code, int) else 0 if left.code is None else 1
        finally:
            os.chdir(before[0])
            sys.argv, sys.stdin = before[1:]
    out.seek(0)
    return code, out.buffer.read().decode("utf-8", "replace"), err.getvalue()


def judge_answer(fate: Fate, code: int, out: str, err: str, folder: Path, given: Input) -> Iterator[str]:
    """Note what became of a case, and yield what is wrong with that."""
    lines = [line for line in err.splitlines() if line.strip() and not line.startswith("note: ")]
    fate.said = lines[-1].removeprefix("fg-nav: ") if lines else ""
    if "Traceback" in err:
        places = [line.split("/fg_nav/")[1] for line in lines if line.startswith("  File ") and "/fg_nav/" in line]
        raised = [line for line in lines if not line.startswith((" ", "fg-nav", "Traceback"))]
        yield f"exception: {' '.join(raised[-1:])[:200]} [{' '.join(places[-1:])}]"
    elif code == cli.EXIT_USER or (code == USAGE and fate.case.kind in ("options", "config")):
        fate.outcome = "refused"
        one = len(lines) == 1 or given.stdin is not None or code == USAGE
        if not one or not lines or not (code == USAGE or lines[-1].startswith("fg-nav: ")):
            yield f"refused in {len(lines)} lines: {' | '.join(lines)[:300]}"
        if (folder / "out").exists():
            yield "a result of what was refused"
    elif code != 0:
        yield f"exit code {code}"
    else:
        fate.outcome = "accepted"
        told = [line for line in out.splitlines() if line.startswith("{")]
        yield from (f"not finite: line {line[:200]}" for line in told if "NaN" in line or "Infinity" in line)
        if given.lost is not None:
            yield from judge_loss([json.loads(line) for line in told], *given.lost)
        if given.words[0] != "simulate":
            summary = json.loads((folder / "out" / "summary.json").read_text())
            fate.said = str(summary.get("verdict"))
            missing = [key for key in ("verdict", "distance_m", "duration_s") if summary.get(key) is None]
            yield from (f"not finite: summary.json, {key}" for key in missing)
            path = np.loadtxt(folder / "out" / "trajectory.tum", ndmin=2)
            names_it = any(
                words in reason for words in ("the foot reaches", "a stride of") for reason in summary["reasons"]
            )
            is_marked = fate.said == UNUSABLE or (fate.said == "doubtful" and names_it)
            yield from judge_path(path, pd.read_csv(folder / "out" / "strides.csv"), is_marked)


def judge_path(path: Floats, strides: pd.DataFrame, is_marked: bool) -> Iterator[str]:
    """Yield what is wrong with the numbers of a result, and with its motion where the verdict does not name that."""
    numbers = strides.select_dtypes("number").drop(columns="compass_weight", errors="ignore")  # empty without a compass
    if not np.isfinite(path).all():
        yield "not finite: trajectory.tum"
    elif (np.diff(path[:, 0]) <= 0).any():
        yield "stamps do not rise: trajectory.tum"
    for name in numbers:
        if not np.isfinite(numbers[name]).all():
            yield f"not finite: strides.csv, {name}"
        # The first row is where coordinates begin, in a pocket without an error.
        if str(name).startswith("sigma") and ((numbers[name] < 0).any() or (numbers[name][1:] <= 0).any()):
            yield f"sigma not above zero: strides.csv, {name}"
    if is_marked or len(path) < 2:
        return
    t, position = path[:, 0], path[:, 1:4]
    later = np.minimum(np.searchsorted(t, t + SPEED_S - 1e-9), len(t) - 1)
    moved = np.linalg.norm(position[later] - position, axis=1) / np.maximum(t[later] - t, SPEED_S)
    if moved.max() > MAX_M_S:
        yield f"absurd: {moved.max():.1f} m/s"
    longest = float(np.hypot(np.diff(strides["x_m"]), np.diff(strides["y_m"])).max(initial=0.0))
    if longest > MAX_STRIDE_M:
        yield f"absurd: a stride of {longest:.1f} m"


def judge_loss(told: Sequence[Mapping[str, Any]], begin: float, end: float) -> Iterator[str]:
    """Yield whether the sigma of the height is larger behind a loss than before it, as the lines of the moment say."""
    now = [(line["t"], line["position_sigma_m"][2]) for line in told if line.get("kind") == "now"]
    before, behind = [s for t, s in now if t <= begin], [s for t, s in now if t >= end]
    lost_s = end - begin
    if lost_s >= LOST_S and before and behind and behind[0] ** 2 - before[-1] ** 2 < (GROWTH_M_S * lost_s) ** 2:
        yield f"sigma: height {before[-1]:.3f} m before, {behind[0]:.3f} m behind {lost_s:.1f} s without a sample"
