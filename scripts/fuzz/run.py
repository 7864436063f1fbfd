"""Broken inputs of every kind, given to the program: nothing may crash, hang, or come out wrong without a word.

    python scripts/fuzz/run.py [--inputs N] [--seed N] [--jobs N] [--only KIND ...] [--bases DIR]
    python scripts/fuzz/run.py --only KIND --seed N --case K [--keep DIR]

samples are pieces of 3 to 25 s of real and simulated recordings, their samples wrong; format, such pieces in each
format that is read, the file damaged; real, real files and folders, damaged; stream, wrong rows on standard input;
record, a walk resumed from a damaged record; truth, fixes, calibration, config, scenario, files that go with a walk;
options, words that cannot be meant. What is done to them stands in `mutations.py`. A case is drawn from its seed, kind
and number alone, and run by the command line's own entry point, in a folder of its own. What it must do:

========== ===========================================================================================================
refused    exit code 1, one sentence, and no result left behind
accepted   exit code 0; all numbers finite, stamps rising, sigmas above zero
never      another exit code, a traceback, a warning of Python's, or a path faster than `MAX_M_S` or with a stride
           over `MAX_STRIDE_M` that is neither called "not to be used" nor doubtful with a reason that names it
========== ===========================================================================================================

Each is run in one of `--jobs` processes, which may die. A fault is printed with what shows it again: the second call
runs one case in this process, prints what it did, and leaves its files in `--keep`.
"""

from __future__ import annotations

import io
import json
import resource
import shutil
import sys
import tempfile
import time
import warnings
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, chdir, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import cache, partial
from multiprocessing import get_context
from pathlib import Path
from threading import local
from typing import TypeAlias
from unittest.mock import patch

import numpy as np
import pandas as pd
import typer

sys.path += [str(Path(__file__).resolve().parents[k]) for k in (1, 2)]  # the scripts; tests, with writers of formats

import harness
import walks
from experiments import find_truth
from fuzz import mutations as wrong
from fuzz.mutations import Rng, draw
from harness import option

from fg_nav import cli
from fg_nav.arrays import Floats
from fg_nav.columns.mapping import CANONICAL
from fg_nav.io import FORMATS, read, write_tum
from fg_nav.lab.simulation import SCENARIOS, Choices, simulate
from fg_nav.lab.store.files import make_folder
from fg_nav.online import follow
from fg_nav.online.buffer import rows_of
from fg_nav.online.record import LINES
from fg_nav.recording import RawRecording
from fg_nav.report.terminal import progress
from fg_nav.verdict import UNUSABLE
from tests.io.every_format import SAMPLES, files_of

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


Input: TypeAlias = tuple[Words, str, bytes | None]
"""A command, what was done to its input, and standard input."""

# --- clean inputs ----------------------------------------------------------------------------------------------------

MAX_S, REAL_BYTES = 90.0, 1_500_000  # of a recording from which pieces are cut; of a real binary file
REAL = (walks.GDIN, "running", "vicon", "gdlbio run", walks.OPENSHOE, "xio", "leg", "by hand")
SIMULATED = ("demo", "office", "mixed-gait", "pocket-street")
IN_POCKET = ("pocket", "ridi", "zhicheng")  # how the names of those in a pocket begin
SCENARIO = """like = "office"
field = "smooth"
rests = "none"
magnets = [[1.5, 10.0, 0.0]]
course = {points_m = [[0, 0], [0, 7], [6, 7]], corner_radius_m = 1.2, laps = 1, rest_s = 2.0, pace = 1.0, run = false}
sensor = {rate_hz = 100, gyr = {noise_density = 1e-4}}
"""
CONFIGURED = ("smoother", "iez", "qsf", "online")  # methods whose config.json is damaged
GRAPHS = ("smoother", "inertial", "online")  # methods that take known positions
PREPARED = (
    "calibrate long.csv --force --out sensor.json",
    *(f"run walk.csv --method {one} --heading 10 --plots none --force --out {one}" for one in CONFIGURED),
    "stream - --plots none --force --out out --record foot < walk-begin.csv",
    "stream - --plots none --force --out out --record lagged --lag 12 < walk-begin.csv",
    "stream - --plots none --force --out out --record thigh --mount pocket < pocket-begin.csv",
)
"""Commands that write what goes with a walk."""


class Store:
    """Clean inputs in a folder that all workers share; `data` holds the real recordings, None where there are none."""

    def __init__(self, folder: Path, data: Path | None) -> None:
        self.folder, self.data = folder, data
        real = [] if data is None else [one for name in REAL for one in walks.list_set(data, name)[:2]]
        self.sources: dict[str, Path | None] = {**dict.fromkeys(SIMULATED), **{one.name: one.path for one in real}}

    def rows(self, name: str) -> Floats:
        """Return the beginning of a recording as rows (n, 10) of t, acc, gyr, mag."""
        return np.asarray(np.load(self.folder / f"{name}.npy"))

    def prepare(self) -> None:
        """Write the rows of all recordings, walks of 16 s on a foot and in a pocket, and what goes with them."""
        for name, path in self.sources.items():
            recording = read(path) if path else simulate(SCENARIOS[name], 1, Choices(rate_hz=100.0)).recording
            last = int(np.searchsorted(recording.t, recording.t[0] + MAX_S))
            np.save(self.folder / f"{name}.npy", rows_of(recording.slice(0, last))[:, :10])
        for name, choices in (("pocket", Choices(rate_hz=100.0, worn="pocket")), ("walk", Choices(rate_hz=100.0))):
            recording = simulate("demo", 1, choices).recording
            for end, part in (("", slice(1600)), ("-begin", slice(1200)), ("-rest", slice(1100, 1600))):
                write_rows(rows_of(recording)[part, :10], self.folder / f"{name}{end}.csv")
        write_rows(rows_of(recording)[:, :10], self.folder / "long.csv")
        truth, nav_R_body = find_truth(recording)
        t, place = truth.t, truth.position - truth.position[0]
        write_tum(self.folder / "truth.tum", t, place, nav_R_body)
        steps = [f"{k},{x:.3f},{y:.3f}" for k, (x, y) in enumerate(place[:930:93, :2])]
        fixes = [f"{t[k]:.2f},{place[k, 0]:.2f},{place[k, 1]:.2f},,0.3" for k in range(300, 1500, 200)]
        (self.folder / "footprints.csv").write_text("\n".join(["stride,x_m,y_m", *steps, ""]))
        (self.folder / "fixes.csv").write_text("\n".join(["time_s,x_m,y_m,z_m,sigma_m", *fixes, ""]))
        (self.folder / "scenario.toml").write_text(SCENARIO)
        for command in PREPARED:
            words, _, stdin = command.partition(" < ")
            rows = (self.folder / stdin).read_bytes() if stdin else None
            code, _, err = call([*words.split(), "--quiet"], self.folder, rows)
            assert code == 0, err
        for method in CONFIGURED:
            shutil.copy(self.folder / method / "config.json", self.folder / f"{method}.json")


# --- recordings ------------------------------------------------------------------------------------------------------

METHODS = (
    *("smoother",) * 6, "inertial", "iez", "iez", "iez-rts", "online", "qsf", "iqsf-rts", "ma2018", "aiez", "matched",
)  # fmt: skip


def cut_piece(store: Store, rng: Rng) -> tuple[Floats, str]:
    """Cut 3 to 10 s, of one in twenty up to 25 s, out of a recording; its rows and its name."""
    name, longest_s = draw(rng, list(store.sources)), 25.0 if rng.random() < 0.05 else 10.0
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
    """Damage a file in place: its bytes, of a text its rows and fields, of JSON its tree; in words how."""
    data = path.read_bytes()
    kind = draw(rng, ("bytes", "broken", "varied", "varied")) if b"\0" not in data[:1000] else "bytes"
    if path.suffix == ".json" and data.rstrip().endswith((b"}", b"]")) and rng.random() < 0.8:
        kind, breaks = "tree", rng.random() < 0.4
        data = json.dumps(wrong.change_tree(json.loads(data), rng, breaks)).encode("utf-8", "replace")
    elif kind == "bytes":
        data, kind = wrong.mutate_bytes(data, rng)
    else:
        text = data.decode("utf-8", "surrogateescape")
        ways = (wrong.BREAKS, 6) if kind == "broken" else (wrong.VARIATIONS, 3)
        changed = wrong.scramble_table(text, rng, max(",;\t ", key=text[:2000].count), *ways)
        data = changed.encode("utf-8", "surrogateescape")
    path.write_bytes(data)
    return kind


def make_samples(store: Store, rng: Rng, folder: Path) -> Input:
    """Samples that are wrong, in a canonical file."""
    piece, name = cut_piece(store, rng)
    rows, what = wrong.mutate_samples(piece, rng)
    write_rows(rows, folder / "walk.csv")
    return ["run", "walk.csv", *choose_method(rng, name)], f"{name}: {what}", None


def make_format(store: Store, rng: Rng, folder: Path) -> Input:
    """A file in one of the formats, damaged as bytes or as a table."""
    rows, name = cut_piece(store, rng)
    mag = np.tile([20.0, 0.0, -43.0], (len(rows), 1)) if np.isnan(rows[:, 7:]).all() else rows[:, 7:]
    raw = RawRecording(rows[:, 0], rows[:, 1:4], rows[:, 4:7], np.arange(2, len(rows) + 2), mag=mag)
    kind = draw(rng, sorted(SAMPLES))
    path = SAMPLES[kind].write(raw, folder)
    what = damage(draw(rng, files_of(path)), rng)
    more = ["--format", draw(rng, list(FORMATS))] if rng.random() < 0.1 else []
    return ["run", path.name, *more, *choose_method(rng, name)], f"{kind} of {name}: {what}", None


@cache
def list_real(data: Path) -> list[Path]:
    """List files that may be recordings, and folders that hold one in several files."""
    files = [path for path in files_of(data) if path.suffix not in (".md", ".tsv") and "LICENSE" not in path.name]
    folders = [path for path in (data / "formats").rglob("*") if path.is_dir() and 1 < len(files_of(path)) < 10]
    return [*sorted(folders), *(path for path in files if path.suffix != ".mat" or path.stat().st_size < REAL_BYTES)]


def make_real(store: Store, rng: Rng, folder: Path) -> Input:
    """A real file, or a folder of files that belong together, one of them damaged."""
    assert store.data is not None
    source, copies = draw(rng, list_real(store.data)), []
    for path in files_of(source):
        data, copy = path.read_bytes(), folder / path.relative_to(source.parent)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(data if b"\0" in data[:4000] else data[: draw(rng, (20_000, 200_000, 600_000))])
        copies.append(copy)
    target, name = draw(rng, copies), source.relative_to(store.data).as_posix()
    return ["run", source.name, *choose_method(rng, name)], f"{name}: {target.name}: {damage(target, rng)}", None


def make_stream(store: Store, rng: Rng, folder: Path) -> Input:
    """Rows on standard input: wrong samples, wrong text, or both."""
    rows, name = cut_piece(store, rng)
    what = kind = draw(rng, ("samples", "text", "both"))
    if kind != "text":
        rows, what = wrong.mutate_samples(rows, rng)
    path = write_rows(rows, folder / "rows")
    if kind != "samples":
        what += f", {damage(path, rng)}"
    mount = ["--mount", "pocket"] if name.startswith(IN_POCKET) else draw(rng, ([], [], ["--lag", "10"]))
    more = draw(rng, ([], [], [], [], ["--no-mag"], ["--polish"], ["--heading=90"], ["--record=record.csv"]))
    return ["stream", "-", "--plots", "none", *mount, *more], f"{name}: {what}", path.read_bytes()


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
    return command.split(), what, (store.folder / stdin).read_bytes() if stdin else None


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
    return ["run", "walk.csv", "--plots", "none", *words], " ".join(words)[:200], None


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
USAGE = 2  # exit code of words that the command line does not understand


def run_case(store: Store, case: Case, keep: Path | None = None) -> Fate:
    """Draw a case, run it, and judge its answer; its folder is kept where that is asked for."""
    fate, rng = Fate(case), np.random.default_rng([case.seed, zlib.crc32(case.kind.encode()), case.number])
    folder = Path(tempfile.mkdtemp(prefix="fg-nav-fuzz-")) if keep is None else keep
    folder.mkdir(exist_ok=True)
    try:
        words, fate.what, stdin = KINDS[case.kind][1](store, rng, folder)
        fate.command = " ".join(["fg-nav", *words, "--out", "out"])
        began = time.process_time()
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            answer = call([*words, "--out", "out"], folder, stdin)
        fate.seconds = time.process_time() - began
        places = {f"{one.category.__name__}: {one.message} [{one.filename}:{one.lineno}]" for one in warned}
        fate.faults = [*sorted(f"warning: {place}" for place in places), *judge_answer(fate, *answer, folder)]
    finally:
        if keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    return fate


def call(words: Words, folder: Path, stdin: bytes | None = None) -> tuple[int, str, str]:
    """Call the entry point of the command line in a folder; its exit code and what it printed."""
    out, err, code = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO(), 0
    (folder / "stdin").write_bytes(stdin or b"")
    with ExitStack() as opened:
        source = opened.enter_context((folder / "stdin").open())
        for changed in (chdir(folder), redirect_stdout(out), redirect_stderr(err)):
            opened.enter_context(changed)
        opened.enter_context(patch.multiple(sys, argv=["fg-nav", *words], stdin=source))
        try:
            cli.main()
        except SystemExit as left:
            code = left.code if isinstance(left.code, int) else int(left.code is not None)
    out.seek(0)
    return code, out.buffer.read().decode("utf-8", "replace"), err.getvalue()


def judge_answer(fate: Fate, code: int, out: str, err: str, folder: Path) -> Iterator[str]:
    """Note what became of a case, and yield what is wrong with that."""
    lines = [line for line in err.splitlines() if line.strip() and not line.startswith("note: ")]
    fate.said = lines[-1].removeprefix("fg-nav: ") if lines else ""
    if "Traceback" in err:
        places = [line.split("/fg_nav/")[1] for line in lines if line.startswith("  File ") and "/fg_nav/" in line]
        raised = [line for line in lines if not line.startswith((" ", "fg-nav", "Traceback"))]
        yield f"exception: {' '.join(raised[-1:])[:200]} [{' '.join(places[-1:])}]"
    elif code == cli.EXIT_USER or (code == USAGE and fate.case.kind in ("options", "config")):
        fate.outcome = "refused"
        one = len(lines) == 1 or fate.case.kind in ("stream", "record") or code == USAGE
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
        if fate.case.kind != "scenario":
            summary = json.loads((folder / "out" / "summary.json").read_text())
            fate.said = str(summary.get("verdict"))
            missing = [key for key in ("verdict", "distance_m", "duration_s") if summary.get(key) is None]
            yield from (f"not finite: summary.json, {key}" for key in missing)
            path = np.loadtxt(folder / "out" / "trajectory.tum", ndmin=2)
            reasons = " ".join(summary["reasons"])
            names_it = "the foot reaches" in reasons or "a stride of" in reasons
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


# --- the campaign ----------------------------------------------------------------------------------------------------

LIMIT_S, MEMORY_BYTES = 180.0, 8 << 30  # on the wall, of an input; of address space that a case may take


def main(arguments: Sequence[str] | None = None) -> None:
    """Run it, print the table and the faults."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        inputs=option(300, "how many, over the kinds by their shares", metavar="N"),
        seed=1,
        jobs=2,
        only=option(list(KINDS), "these kinds only", nargs="+", choices=list(KINDS), metavar="KIND"),
        case=option(None, "this case only, of one kind", type=int, metavar="K"),
        keep=option(None, "of one case: leave its files here", type=Path, metavar="DIR"),
        bases=option(None, "keep clean inputs here from run to run", type=Path, metavar="DIR"),
        data=None,
    )
    with tempfile.TemporaryDirectory(prefix="fg-nav-fuzz-") as folder:
        store = Store(make_folder(chosen.bases or Path(folder)).resolve(), walks.data_folder(chosen.data))
        prepare_process()
        if not (store.folder / "smoother.json").exists():
            store.prepare()
        if chosen.case is not None:
            fate = run_case(store, Case(chosen.only[0], chosen.seed, chosen.case), chosen.keep)
            print(
                f"{fate.what}\n{fate.command}\n{fate.outcome}: {fate.said} ({fate.seconds:.2f} s)",
                *fate.faults,
                sep="\n",
            )
            return
        shares = {kind: KINDS[kind][0] for kind in chosen.only}
        counts = {kind: -(-chosen.inputs * share // sum(shares.values())) for kind, share in shares.items()}
        cases = [Case(kind, chosen.seed, number) for kind, count in counts.items() for number in range(count)]
        fates = run_all(cases, store, chosen.jobs, LIMIT_S)
    print_fates(fates)


@cache
def prepare_process() -> None:
    """Make this process one that runs cases: bounded memory, no processes of a walk's own, the verbs loaded once."""
    with suppress(ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, resource.RLIM_INFINITY))
    typer.main.get_command = cache(typer.main.get_command)
    whole = follow.StreamOptions
    # The answers of a walk that is solved again in this process are the same, and it needs no second to start.
    setattr(follow, "StreamOptions", lambda **given: whole(**{**given, "background": False}))  # noqa: B010


def run_all(cases: Sequence[Case], store: Store, jobs: int, limit_s: float) -> list[Fate]:
    """Run cases, each thread with a process of its own; print faults."""
    own, fates, context = local(), list[Fate](), get_context("spawn")

    def run(case: Case) -> Fate:
        if getattr(own, "pool", None) is None:
            own.pool = ProcessPoolExecutor(1, context, prepare_process)
            own.pool.submit(prepare_process).result()  # what it loads is no time of the case
        (process,) = own.pool._processes.values()
        try:
            fate: Fate = own.pool.submit(run_case, store, case).result(limit_s)
            return fate
        except BrokenProcessPool:
            process.join()
            words = f"crash: exit code {process.exitcode}"
        except TimeoutError:
            words = f"hang: more than {limit_s:g} s"
        except Exception as error:  # of the fuzz itself: the input was not made, and the others go on
            return Fate(case, faults=[f"not made: {type(error).__name__}: {error}"])
        process.kill()
        own.pool.shutdown(wait=False)
        own.pool = None
        return Fate(case, faults=[words])

    with ThreadPoolExecutor(jobs) as threads, progress(f"fuzz: {len(cases)}") as report:
        for number, fate in enumerate(threads.map(run, cases), 1):
            report(number / len(cases))
            fates.append(fate)
            if fate.faults:
                again = f"--only {fate.case.kind} --seed {fate.case.seed} --case {fate.case.number}"
                print(f"{again}: {'; '.join(fate.faults)[:400]} ({fate.what}; {fate.command})", flush=True)
    return fates


def print_fates(fates: Sequence[Fate]) -> None:
    """Print the table of kinds."""
    words, rows = ("refused", "accepted", "trusted", "doubtful", UNUSABLE), []
    for kind in (*KINDS, "all"):
        some = [fate for fate in fates if kind in (fate.case.kind, "all")]
        if not some:
            continue
        said = Counter(word for fate in some for word in (fate.outcome, fate.said))
        counts = [len(some), *(said[word] for word in words), sum(bool(fate.faults) for fate in some)]
        rows.append([kind, *map(str, counts), f"{max((fate.seconds for fate in some), default=0.0):.1f}"])
    harness.print_table(("kind", "inputs", *words, "faults", "longest, s"), rows)


if __name__ == "__main__":
    harness.run(main)
