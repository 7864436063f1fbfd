"""Cases of the fuzz campaign: an input of a kind, the command that is given it, and what is held against its answer.

A case is drawn from its seed, kind and number alone, and run by the command line's own entry point in this process
(`fg_nav.cli.main`), in a folder of its own. What it must do:

========== ===========================================================================================================
refused    exit code 1, one sentence, and no result left behind
accepted   exit code 0; every number of the result finite, stamps rising, sigmas above zero, a verdict
never      another exit code, a traceback, a warning of Python's, or a path faster than `MAX_M_S` or with a stride
           over `MAX_STRIDE_M` that is not called "not to be used"
========== ===========================================================================================================
"""

from __future__ import annotations

import io
import json
import os
import resource
import shutil
import sys
import tempfile
import threading
import time
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, TypeAlias

import fuzz_mutations as wrong
import fuzz_variations as varied
import numpy as np
import pandas as pd
import typer
from fuzz_inputs import CONFIGURED, HEADER, Store, raw_of
from fuzz_mutations import Rng, draw

from fg_nav import cli
from fg_nav.arrays import Floats
from fg_nav.online import follow
from fg_nav.online.record import LINES
from fg_nav.recording import RawRecording
from fg_nav.verdict import UNUSABLE

MAX_M_S, MAX_STRIDE_M = 12.0, 4.0  # Beyond these a path is no walk, and must be called not to be used.
MEMORY_BYTES = 8 << 30  # Of address space that a case may take.

SPEED_S = 0.1
"""Over which a speed is measured: a causal filter moves its path at once where it learns of an error at a footfall."""

Words: TypeAlias = list[str]

sys.path.append(str(Path(__file__).resolve().parents[1]))  # the tests have a writer for each format


@dataclass(frozen=True)
class Case:
    """One input: `seed`, `kind` and `number` are all that it is drawn from."""

    kind: str
    seed: int
    number: int

    @property
    def rng(self) -> Rng:
        """What it is drawn with."""
        return np.random.default_rng([self.seed, zlib.crc32(self.kind.encode()), self.number])


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
    """What a kind makes: words of the command line, text for standard input, and what was done to it."""

    words: Words
    what: str
    stdin: bytes | None = None
    has_result: bool = True


# --- recordings ------------------------------------------------------------------------------------------------------

MIN_S, USUAL_S, MAX_S = 3.0, 10.0, 25.0  # Of a piece; one in twenty may be longer than usual.

INERTIAL = ("smoother",) * 6 + ("inertial", "iez", "iez", "iez-rts")
COMPASS = ("qsf", "iqsf-rts", "ma2018", "aiez", "matched")  # Methods without and with a magnetometer.

ONLINE = ("online",)
POCKET = ("pocket", "munoz-diaz2017", "online")


def cut_piece(store: Store, rng: Rng, with_field: bool = False) -> tuple[Floats, str]:
    """Cut a piece out of a recording; its rows and its name."""
    longest_s = MAX_S if rng.random() < 0.05 else USUAL_S
    name = draw(rng, store.recordings)
    rows = store.rows(name)
    if with_field and np.isnan(rows[:, 7:10]).all():
        rows[:, 7:10] = [20.0, 0.0, -43.0]
    duration = np.exp(rng.uniform(np.log(MIN_S), np.log(longest_s)))
    start = rng.uniform(rows[0, 0], max(rows[0, 0], rows[-1, 0] - duration))
    kept = rows[(rows[:, 0] >= start) & (rows[:, 0] < start + duration)]
    return kept, f"{name} from {start - rows[0, 0]:.1f} s, {duration:.1f} s"


def choose_method(rng: Rng, name: str = "", has_field: bool = True) -> Words:
    """Draw a method, mostly one that fits the recording of this name, and options."""
    in_pocket = rng.random() < (0.85 if name.startswith(("thigh", "ridi")) else 0.03)
    words = ["--plots", "none" if rng.random() < 0.95 else "html"]
    if in_pocket:
        words += ["--mount", "pocket", "--method", str(rng.choice(POCKET))]
    else:
        words += ["--method", str(rng.choice(INERTIAL + ONLINE + COMPASS * (has_field or rng.random() < 0.05)))]
    if rng.random() < 0.15:
        words += ["--no-mag"] if rng.random() < 0.5 else [f"--heading={rng.choice(HEADINGS)}"]
    return words


HEADINGS = ("0", "90", "-7200", "1e9", "361.5")


def make_samples(store: Store, rng: Rng, folder: Path) -> Input:
    """Samples that are wrong, in a canonical file."""
    rows, name = cut_piece(store, rng)
    rows, what = wrong.mutate_samples(rows, rng)
    write_rows(rows, folder / "walk.csv")
    return Input(["run", "walk.csv", *choose_method(rng, name, _has_field(rows))], f"{name}: {what}")


def _has_field(rows: Floats) -> bool:
    return bool(np.isfinite(rows[:, 7:10]).all(axis=1).any())


def write_rows(rows: Floats, path: Path) -> None:
    """Write canonical rows, whatever they hold."""
    lines = (",".join(map(repr, row)).replace("nan", "") for row in rows.tolist())
    path.write_text("\n".join([",".join(HEADER), *lines, ""]))


def make_format(store: Store, rng: Rng, folder: Path) -> Input:
    """A file in one of the formats, damaged as bytes or as a table."""
    rows, name = cut_piece(store, rng, with_field=True)
    kind, path = write_format(raw_of(rows), rng, folder)
    what = damage_file(path, rng)
    format_words = ["--format", str(rng.choice(FORMAT_NAMES))] if rng.random() < 0.1 else []
    return Input(["run", "walk.dat", *format_words, *choose_method(rng, name)], f"{kind} of {name}: {what}")


FORMAT_NAMES = ("canonical", "table", "xio", "pyshoe", "openshoe", "sensorlog", "xsens-dot", "ros")


def write_format(raw: RawRecording, rng: Rng, folder: Path) -> tuple[str, Path]:
    """Write `walk.dat`, a file or a folder, in a format that is drawn; its name, and the file to be damaged."""
    from tests.io.foreign_phones import PHONES, write_files
    from tests.io.foreign_sensors import FOREIGN, write_bag, write_metawear, write_ximu3
    from tests.io.samples import WRITERS

    of_files: dict[str, Callable[[RawRecording, Path], Any]] = {
        **{name: writer for name, (_, writer) in WRITERS.items()},
        **{name: how.write for name, how in FOREIGN.items()},
        **{name: lambda raw, path, app=app: write_files(app.files(raw), path) for name, app in PHONES.items()},
        "metawear": write_metawear,
        "x-imu3": write_ximu3,
        "bag 1": lambda raw, path: _rename(path, ".bag", raw, write_bag),
        "bag 2": lambda raw, path: write_bag(raw, path),
    }
    path = folder / "walk.dat"
    kind = str(rng.choice(list(of_files)))
    of_files[kind](raw, path)
    files = sorted(one for one in path.rglob("*") if one.is_file()) if path.is_dir() else [path]
    return kind, draw(rng, files)


def _rename(path: Path, suffix: str, raw: RawRecording, write: Callable[[RawRecording, Path], None]) -> None:
    write(raw, path.with_suffix(suffix))
    path.with_suffix(suffix).rename(path)


def damage_file(path: Path, rng: Rng) -> str:
    """Damage a file in place; in words how."""
    data, what = damage(path.read_bytes(), rng)
    path.write_bytes(data)
    return what


def damage(data: bytes, rng: Rng) -> tuple[bytes, str]:
    """Damage what a file holds: its bytes, and of a text its rows, fields and numbers."""
    kind = draw(rng, ("bytes", "bytes", "varied", *TEXT_CHANGES)) if b"\0" not in data[:1000] else "bytes"
    if kind == "bytes" and rng.random() < 0.2:
        return varied.vary_words(data, rng), "words"
    if kind == "bytes":
        return wrong.mutate_bytes(data, rng)
    text = data.decode("utf-8", "surrogateescape")
    separator = max(",;\t ", key=text[:2000].count)
    return TEXT_CHANGES[kind](text, rng, separator).encode("utf-8", "surrogateescape"), kind


TEXT_CHANGES: Mapping[str, Callable[[str, Rng, str], str]] = {
    "table": wrong.scramble_table,
    "numbers": lambda text, rng, _: wrong.change_numbers(text, rng),
    "columns": wrong.scale_columns,
    "varied": varied.vary_table,
    "varied numbers": lambda text, rng, _: varied.vary_numbers(text, rng),
}
"""What is done to a text, given its separator."""


REAL_BYTES = 1_500_000  # Of a real file; more is cut off a text, or not taken.


def make_real(store: Store, rng: Rng, folder: Path) -> Input:
    """A real file, or a folder of files that belong together, one of them damaged."""
    if store.data is None:
        return make_format(store, rng, folder)
    kind = "folders" if rng.random() < 0.3 else "files"
    sources = _list_folders(store.data) if kind == "folders" else _list_files(store.data)
    source = draw(rng, store.keep_readable(kind, sources) if rng.random() < 0.8 else sources)
    copies = [_copy_start(path, folder / path.relative_to(source.parent), rng) for path in _files_of(source)]
    target = draw(rng, copies)
    what = damage_file(target, rng)
    name = str(source.relative_to(store.data))
    words = ["run", source.name, *choose_method(rng, name.replace("ridi_leg", "ridi"))]
    return Input(words, f"{name}: {target.name}: {what}")


def _copy_start(path: Path, target: Path, rng: Rng) -> Path:
    """Copy a binary file, or the first rows of a text."""
    data = path.read_bytes()
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(data if b"\0" in data[:4000] else data[: int(rng.choice([20_000, 200_000, 600_000]))])
    return target


def _files_of(source: Path) -> list[Path]:
    return [path for path in sorted(source.rglob("*")) if path.is_file()] if source.is_dir() else [source]


@cache
def _list_files(data: Path) -> list[Path]:
    files = [path for path in _files_of(data) if path.suffix not in (".md", ".tsv") and "LICENSE" not in path.name]
    return [path for path in files if path.suffix != ".mat" or path.stat().st_size < REAL_BYTES]


@cache
def _list_folders(data: Path) -> list[Path]:
    """Folders that hold one recording in several files."""
    return [path for path in sorted((data / "formats").rglob("*")) if path.is_dir() and 1 < len(_files_of(path)) < 10]


# --- streams and records ---------------------------------------------------------------------------------------------


def make_stream(store: Store, rng: Rng, folder: Path) -> Input:
    """Rows on standard input: wrong samples, wrong text, or both."""
    rows, name = cut_piece(store, rng)
    what, kind = "", rng.integers(3)
    if kind != 1:
        rows, what = wrong.mutate_samples(rows, rng)
    write_rows(rows, folder / "rows")
    data = (folder / "rows").read_bytes()
    if kind != 0:
        data, how = damage(data, rng)
        what = ", ".join(filter(None, (what, how)))
    words = ["stream", "-", "--plots", "none"]
    if name.startswith(("thigh", "ridi")) and rng.random() < 0.85:
        words += ["--mount", "pocket"]
    elif rng.random() < 0.3:
        words += ["--lag", "10"]
    if rng.random() < 0.15:
        words += [draw(rng, ("--no-mag", "--polish", "--heading=90", "--record=record.csv"))]
    return Input(words, f"{name}: {what}", data)


RECORDS: Mapping[str, tuple[str, Words]] = {
    "foot": ("foot-rest.csv", []),
    "lagged": ("foot-rest.csv", ["--lag", "12"]),
    "thigh": ("thigh-rest.csv", ["--mount", "pocket"]),
}
"""Rows that follow, and the options of the walk."""


def make_record(store: Store, rng: Rng, folder: Path) -> Input:
    """A record of which the samples or the lines are damaged."""
    kind, damaged = draw(rng, list(RECORDS)), draw(rng, ("", LINES, LINES))
    for end in ("", LINES):
        (folder / f"record.csv{end}").write_bytes(store.companion(f"{kind}.record{end}"))
    what = damage_file(folder / f"record.csv{damaged}", rng)
    rest, words = RECORDS[kind]
    given = ["stream", "-", "--record", "record.csv", "--resume", "--plots", "none", *words]
    return Input(given, f"{kind}{damaged}: {what}", store.companion(rest))


# --- companions ------------------------------------------------------------------------------------------------------


def _make_companion(
    option: str,
    names: tuple[str, ...],
    words: Callable[[Rng], Words],
    change: Callable[[bytes, Rng], tuple[bytes, str]],
) -> Callable[[Store, Rng, Path], Input]:
    def make(store: Store, rng: Rng, folder: Path) -> Input:
        (folder / "walk.csv").write_bytes(store.companion("walk.csv"))
        name = draw(rng, names)
        data, what = change(store.companion(name), rng)
        (folder / name).write_bytes(data)
        return Input(["run", "walk.csv", f"{option}={name}", *words(rng), "--plots", "none"], f"{name}: {what}")

    return make


def change_json(data: bytes, rng: Rng) -> tuple[bytes, str]:
    """Change the tree of a JSON file, or its text."""
    kind = rng.random()
    if kind < 0.2:
        return damage(data, rng)
    if kind < 0.7:
        return json.dumps(varied.vary_tree(json.loads(data), rng)).encode("utf-8", "replace"), "varied tree"
    try:
        return json.dumps(wrong.mutate_tree(json.loads(data), rng)).encode("utf-8", "replace"), "tree"
    except RecursionError:
        return b"[" * 100_000, "nested"


def _aligned(rng: Rng) -> Words:
    return [*_fast(rng), *(["--alignment", draw(rng, ("none", "origin", "se3"))] if rng.random() < 0.5 else [])]


def _fast(rng: Rng) -> Words:
    return ["--method", draw(rng, ("iez", "iez", "smoother"))]


def _graph(rng: Rng) -> Words:
    return ["--method", draw(rng, ("smoother", "inertial", "online"))]


def make_scenario(store: Store, rng: Rng, folder: Path) -> Input:
    """A scenario file that is damaged, for the simulator."""
    data, what = damage(store.companion("scenario.toml"), rng)
    (folder / "scenario.toml").write_bytes(data)
    return Input(["simulate", "scenario.toml", "--seed", str(rng.integers(100))], what, has_result=False)


def make_options(store: Store, rng: Rng, folder: Path) -> Input:
    """Words of the command line that cannot be meant."""
    (folder / "walk.csv").write_bytes(store.companion("walk.csv"))
    words: Words = ["--method", draw(rng, ("smoother", "iez", "online"))]
    for _ in range(rng.integers(1, 4)):
        name, values = draw(rng, list(OPTION_VALUES.items()))
        words += [f"{name}={draw(rng, values)}"]
    for name, content in CONFIGS.items():
        if any(name in word for word in words):
            (folder / name).write_bytes(content)
    return Input(["run", "walk.csv", "--plots", "none", *words], " ".join(words)[:200])


CONFIGS: Mapping[str, bytes] = {
    "nested.json": b"[" * 100_000 + b"]" * 100_000,
    "deep.json": b'{"parameters": ' * 900 + b"1" + b"}" * 900,
    "huge.json": b'{"method": "smoother", "parameters": {"smoother": {"acc_density": 1' + b"0" * 5000 + b"}}}",
    "keys.json": b"{" + b",".join(b'"%d": %d' % (k, k) for k in range(20_000)) + b"}",
}
"""Files that --config, --calibration and others may be given."""

_FILES = ("missing.csv", ".", "walk.csv", "/dev/null", "/dev/zero", "/proc/self/mem", *CONFIGS)
_NUMBERS_GIVEN = ("nan", "inf", "-inf", "1e300", "-1e300", "0", "-1", "1e-300", "x", "", "9" * 400, "45")
OPTION_VALUES: Mapping[str, tuple[str, ...]] = {
    "--heading": _NUMBERS_GIVEN,
    "--rate": _NUMBERS_GIVEN,
    "--mag-axes": ("x,y,z", "x,x,z", "-y,x,z", "x,y", "", ",,", "-x,-y,-z", "y,x,z", "--x,y,z", "x,y,z,x", "X,Y,Z",
                   "x y z", "x,y,-", "+x,+y,+z", "x,y,z" * 1000, "\u2212x,y,z", "1,2,3", "-z,-y,-x", "z,x,y", "-x,y,z"),
    "--columns": ("time=1,acc=2:3:4,gyr=5:6:7", "acc=2", "time=1[ms],acc=2:3:4[g],gyr=5:6:7[deg/s]", "=", "time=99",
                  "time=1,acc=2:2:2,gyr=5:6:7", "time=-1,acc=0:0:0,gyr=5:6:7", "time=time_s[parsec]", "[", "a=b=c",
                  "time=time_s,acc=acc_x_m_s2:acc_y_m_s2:acc_z_m_s2,gyr=gyr_x_rad_s:gyr_y_rad_s:gyr_z_rad_s",
                  "time=1,acc=2:3:4,gyr=5:6:7,mag=8:9:10", "time=1,acc=2:3:4,gyr=5:6:7,mag=8:9:10[gauss]",
                  "acc=2:3:4,gyr=5:6:7", "time=1[us],acc=4:3:2,gyr=7:6:5", "time=1,acc=5:6:7,gyr=2:3:4", "," * 5000,
                  "time=1,acc=" + "9" * 400 + ":3:4,gyr=5:6:7", "acc=acc:acc:acc", "time=\0", "x" * 10_000),
    "--set": ("smoother.magnetic.rounds=-1", "smoother.node_spacing_s=0", "smoother.node_spacing_s=1e300", "x=1",
              "smoother.gravity=nan", "smoother.acc_density=0", "smoother.gyr_density_deg_s=1e300", "=", "smoother",
              "detector.threshold=0", "detector.threshold=-1", "detector.threshold=1e300", "iez.x=1",
              "smoother.acc_density=1e-300", "smoother.magnetic=3", "detector.window_s=0", "detector.window_s=1e9"),
    "--format": ("canonical", "table", "pyshoe", "ros", "", "x"),
    "--gate": ("qsf", "none", "x", ""),
    "--preset": ("tuned", "physical", "as-printed", "x"),
    "--sensor": ("", "x", "\0"),
    "--mount": ("pocket", "foot", "x"),
    "--known-distance": _NUMBERS_GIVEN,
    "--step-constant": _NUMBERS_GIVEN,
    "--fixes": _FILES,
    "--truth": _FILES,
    "--calibration": _FILES,
    "--config": _FILES,
}  # fmt: skip
"""Words for options, most of which cannot be meant."""

KINDS: Mapping[str, tuple[int, Callable[[Store, Rng, Path], Input]]] = {
    "samples": (35, make_samples),
    "format": (16, make_format),
    "real": (7, make_real),
    "stream": (12, make_stream),
    "record": (9, make_record),
    "truth": (4, _make_companion("--truth", ("truth.tum", "footprints.csv"), _aligned, damage)),
    "fixes": (4, _make_companion("--fixes", ("fixes.csv",), _graph, damage)),
    "calibration": (4, _make_companion("--calibration", ("sensor.json",), _fast, change_json)),
    "config": (4, _make_companion("--config", tuple(CONFIGURED), lambda rng: [], change_json)),
    "scenario": (2, make_scenario),
    "options": (3, make_options),
}
"""Share of the campaign in percent, and what makes an input."""


# --- running ---------------------------------------------------------------------------------------------------------


@cache
def prepare_process() -> None:
    """Make this process one that runs cases: bounded memory, no processes of a walk's own, the verbs loaded once."""
    with suppress(ValueError):
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, resource.RLIM_INFINITY))
    typer.main.get_command = cache(typer.main.get_command)
    whole = follow.StreamOptions
    # The answers of a walk that is solved again in this process are the same, and it needs no second to start.
    follow.StreamOptions = lambda **given: whole(**{**given, "background": False})  # type: ignore[assignment,misc]


def run_case(case: Case, store: Store, keep: Path | None = None) -> Fate:
    """Draw a case, run it, and judge its answer; its folder is kept where that is asked for."""
    fate, rng = Fate(case), case.rng
    folder = Path(tempfile.mkdtemp(prefix="fg-nav-fuzz-")) if keep is None else keep
    folder.mkdir(exist_ok=True)
    try:
        given = KINDS[case.kind][1](store, rng, folder)
        given.words += ["--out", "out"]
        fate.what, fate.command = given.what, " ".join(["fg-nav", *given.words])
        if given.stdin is not None and keep is not None:
            (folder / "stdin").write_bytes(given.stdin)
        _run(given, folder, fate)
    finally:
        if keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    return fate


def _run(given: Input, folder: Path, fate: Fate) -> None:
    began = time.process_time()
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        code, out, err = call(given.words, folder, given.stdin)
    fate.seconds = time.process_time() - began
    fate.faults += sorted({_say_warning(one) for one in warned})
    judge_answer(fate, code, out, err, folder / "out", given)


def _say_warning(one: warnings.WarningMessage) -> str:
    where = "/".join(Path(one.filename).parts[-2:])
    return f"warning: {one.category.__name__}: {one.message} [{where}:{one.lineno}]"


def call(words: Words, folder: Path, stdin: bytes | None = None) -> tuple[int, str, str]:
    """Call the entry point of the command line in a folder; its exit code and what it printed."""
    out, err = io.TextIOWrapper(io.BytesIO(), "utf-8"), io.StringIO()
    before, arguments = Path.cwd(), sys.argv
    os.chdir(folder)
    sys.argv = ["fg-nav", *words]
    try:
        with redirect_stdout(out), redirect_stderr(err), feed(stdin):
            cli.main()
    except SystemExit as left:
        code = left.code if isinstance(left.code, int) else 0 if left.code is None else 1
    finally:
        os.chdir(before)
        sys.argv = arguments
    out.flush()
    return code, out.buffer.getvalue().decode("utf-8", "replace"), err.getvalue()  # type: ignore[attr-defined]


@contextmanager
def feed(stdin: bytes | None) -> Iterator[None]:
    """Give these bytes on standard input, in pieces as a pipe does."""
    if stdin is None:
        yield
        return
    reading, writing = os.pipe()
    before, sys.stdin = sys.stdin, os.fdopen(reading)
    feeder = threading.Thread(target=_write_all, args=(writing, stdin), daemon=True)
    feeder.start()
    try:
        yield
    finally:
        sys.stdin.close()  # the feeder, where it still writes, ends by that
        sys.stdin = before
        feeder.join()


def _write_all(descriptor: int, data: bytes) -> None:
    with suppress(BrokenPipeError), os.fdopen(descriptor, "wb", buffering=0) as pipe:
        for start in range(0, len(data), 50_000):
            pipe.write(data[start : start + 50_000])


# --- judging ---------------------------------------------------------------------------------------------------------

USAGE = 2  # Exit code of words that the command line does not understand.


def judge_answer(fate: Fate, code: int, out: str, err: str, result: Path, given: Input) -> None:
    """Say what became of a case and what is wrong with that."""
    lines = [line for line in err.splitlines() if line.strip() and not line.startswith("note: ")]
    fate.said = lines[-1].removeprefix("fg-nav: ") if lines else ""
    if "Traceback" in err:
        fate.faults.append(f"exception: {_last_frame(lines)}")
    elif code == cli.EXIT_USER:
        fate.outcome = "refused"
        fate.faults += _judge_refusal(lines, result, given)
    elif code == USAGE and fate.case.kind in ("options", "config"):
        fate.outcome = "refused"
    elif code != 0:
        fate.faults.append(f"exit code {code}")
    else:
        fate.outcome = "accepted"
        if given.has_result:
            _judge_lines(fate, out)
            _judge_result(fate, result)


def _last_frame(lines: Words) -> str:
    """The exception, and the last place of this package that it passed."""
    places = [line.strip() for line in lines if line.lstrip().startswith("File ") and "/fg_nav/" in line]
    raised = [line for line in lines if line and not line[0].isspace() and not line.startswith(("fg-nav", "Traceback"))]
    where = places[-1].split("/fg_nav/")[-1].replace('", line ', ":").replace(", in ", " ") if places else "?"
    return f"{raised[-1][:200] if raised else '?'} [{where}]"


def _judge_refusal(lines: Words, result: Path, given: Input) -> Words:
    faults = []
    if not lines or not lines[-1].startswith("fg-nav: ") or (given.stdin is None and len(lines) != 1):
        faults.append(f"refused in {len(lines)} lines: {' | '.join(lines)[:300]}")
    if result.exists():
        faults.append("a result of what was refused")
    return faults


def _judge_lines(fate: Fate, out: str) -> None:
    for line in out.splitlines():
        if line.startswith("{") and ("NaN" in line or "Infinity" in line):
            fate.faults.append(f"not finite: line {line[:200]}")
            return


def _judge_result(fate: Fate, result: Path) -> None:
    summary = json.loads((result / "summary.json").read_text())
    fate.said = str(summary.get("verdict"))
    path = np.loadtxt(result / "trajectory.tum", ndmin=2)
    strides = pd.read_csv(result / "strides.csv")
    fate.faults += [*_judge_numbers(path, strides), *_judge_summary(summary)]
    if len(path) > 1 and fate.said != UNUSABLE:
        fate.faults += _judge_motion(path, strides)


def _judge_numbers(path: Floats, strides: pd.DataFrame) -> Iterator[str]:
    numbers = strides.select_dtypes("number")
    if "compass_weight" in numbers and numbers["compass_weight"].isna().all():  # empty where the method does not say
        numbers = numbers.drop(columns="compass_weight")
    if not np.isfinite(path).all():
        yield "not finite: trajectory.tum"
    elif len(path) > 1 and (np.diff(path[:, 0]) <= 0).any():
        yield "stamps do not rise: trajectory.tum"
    for name in numbers.columns[~np.isfinite(numbers.to_numpy(dtype=float)).all(axis=0)]:
        yield f"not finite: strides.csv, {name}"
    for name in [name for name in numbers.columns if name.startswith("sigma")]:
        # The first row is where coordinates begin, in a pocket without an error.
        zero = (numbers[name] <= 0) & ((numbers.index > 0) | (numbers[name] < 0))
        if zero.any():
            yield f"sigma not above zero: strides.csv, {name}, row {int(np.argmax(zero))} of {len(numbers)}"


def _judge_summary(summary: Mapping[str, Any]) -> Iterator[str]:
    if summary.get("verdict") is None:
        yield "no verdict"
    for name in ("distance_m", "duration_s"):
        if summary.get(name) is None:
            yield f"not finite: summary.json, {name}"


def _judge_motion(path: Floats, strides: pd.DataFrame) -> Iterator[str]:
    t, position = path[:, 0], path[:, 1:4]
    later = np.minimum(np.searchsorted(t, t + SPEED_S - 1e-9), len(t) - 1)
    moved = np.linalg.norm(position[later] - position, axis=1)
    fastest = float((moved / np.maximum(t[later] - t, SPEED_S)).max())
    if fastest > MAX_M_S:
        yield f"absurd: {fastest:.1f} m/s"
    if len(strides) > 1:
        longest = float(np.hypot(np.diff(strides["x_m"]), np.diff(strides["y_m"])).max())
        if longest > MAX_STRIDE_M:
            yield f"absurd: a stride of {longest:.1f} m"
