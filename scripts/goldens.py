"""Golden results of the command line: kept before a change of the code's structure, compared after it.

    python scripts/goldens.py keep DIR [--only WORD ...] [--data DIR] [--jobs N]
    python scripts/goldens.py compare DIR [--only WORD ...] [--data DIR] [--jobs N]

`keep` runs the commands below and keeps, in a folder outside the repository, their exit codes, both outputs and the
files of their results. `compare` runs them again and names each line that differs; it exits with 1 if one does. With
`--only` the commands whose names contain one of the words.

Compared are words, byte for byte, and numbers, to `TOLERANCE` and one unit of their last printed digit. Left out:
times of computing, the folder's name, and pages and pictures, of which the text of `PAGES` alone is kept.

======= ===========================================================================================================
run     simulated and real walks: demo, office, laps, squares, gdin, gdlbio, vicon, stairs with fixes, places, two feet,
        pockets; two comparisons with their pages
filter  every filter with every preset, and smoothed
stream  all, with a lag, killed and resumed, both feet, a pocket
refused damaged tables, the cases of ../shared/cases, wrong options
read    `inspect` of every foreign format
======= ===========================================================================================================
"""

from __future__ import annotations

import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import harness
import numpy as np
import walks
from fuzz_cases import call
from harness import option

from fg_nav.errors import SimulationError

TOLERANCE = 2e-9  # m, rad and everything else, and relative: results are printed with nine digits.
KEPT = {".json", ".csv", ".tum", ".jsonl", ".geojson", ".kml", ".npy"}
PAGES = {"compare-gdin", "run-lap"}  # Results whose report.html is kept too.
TIMED = re.compile(
    r"runtime|real.?time|busy|latenc|processor|created|generated|_ms\"|fg-nav \d|no sample has come|came again"
)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MAX_SHOWN = 3  # Differing lines of a file.
PRESETS = ("tuned", "physical", "as-printed")
FILTERS = ("iez", "qsf", "qsf-stance", "iqsf", "ma2018", "aiez", "matched")


@dataclass(frozen=True)
class Golden:
    """One command.

    Attributes
    ----------
    words : for `fg-nav`, run in an empty folder; `DATA/`, `CASES/` and `MADE/` stand for the folders of recordings.
    killed : whether a process with the same words is killed amid the walk first.
    """

    name: str
    words: str
    killed: bool = False


def list_goldens(data: Path, made: Path) -> list[Golden]:
    """List the commands, slow ones first."""
    out = "--out out --plots none"
    runs = {
        "run-demo": "demo --out out",
        "run-office": f"run MADE/office/recording.csv --truth MADE/office/truth.tum {out}",
        "run-lap": "run DATA/mems_foot/lap_360m_1.csv.gz --out out --plots html",
        "run-square-barometer": (
            f"run DATA/mems_foot/square_70m_1.csv.gz --barometer DATA/mems_foot/square_70m_1.baro.csv.gz {out}"
        ),
        "run-gdin": f"run DATA/gdin/own/SensorConnectData_33.csv {out}",
        "run-gdin-no-mag": f"run DATA/gdin/own/SensorConnectData_40.csv --no-mag {out}",
        "run-gdlbio": f"run DATA/gdlbio/SensorConnectData_60_GDLBIO.mat {out}",
        "run-vicon": f"run DATA/vicon/2017-11-22-11-26-05.mat DATA/vicon/2017-11-27-11-14-52.mat {out}",
        "run-stairs-fixes": f"run DATA/mtig710/2022_1_14_stair_walk_up_foot1.csv.gz --fixes MADE/fixes.csv {out}",
        "run-gnss": f"run DATA/pocket_gnss/pocket_pace_01_004.zip --mount pocket --gnss own {out}",
        "run-saves-places": f"run MADE/office/recording.csv --heading 0 --save-places out/places.npz {out}",
        "run-on-places": f"run DATA/mems_foot/lap_360m_2.csv.gz --places MADE/places.npz {out}",
        "run-online": f"run MADE/short.csv --method online --polish {out}",
        "run-feet-simulated": f"run MADE/both/left.csv MADE/both/right.csv --mount feet {out}",
        "run-feet-real": (
            "run DATA/feet_2min/good_leftfoot.csv.gz DATA/feet_2min/good_rightfoot.csv.gz --mount feet " + out
        ),
        "run-pocket-real": f"run DATA/pocket_gnss/pocket_walk_03_005.zip --mount pocket {out}",
        "run-pocket-simulated": f"run MADE/pocket/recording.csv --mount pocket {out}",
        "run-pocket-online": f"run MADE/pocket/recording.csv --mount pocket --method online {out}",
        "run-munoz-diaz": f"run MADE/pocket/recording.csv --mount pocket --method munoz-diaz2017 {out}",
        "compare-gdin": "compare DATA/gdin/own/SensorConnectData_36.csv --out out",
        "calibrate": "calibrate MADE/office/recording.csv --out out.json",
        "detect": "detect MADE/short.csv --out out",
        "inspect-office": "inspect MADE/office/recording.csv",
    }
    for method in FILTERS:
        for preset in PRESETS:
            runs[f"filter-{method}-{preset}"] = f"run MADE/short.csv --method {method} --preset {preset} {out}"
        runs[f"filter-{method}-rts"] = f"run MADE/short.csv --method {method}-rts {out}"
    rest = "--silence 0.3 --out out --plots none"
    runs |= {
        "stream-whole": f"stream MADE/short.csv {rest} --polish",
        "stream-lag": f"stream MADE/short.csv --heading 0 --lag 15 {rest}",
        "stream-square": f"stream MADE/square.csv {rest}",
        "stream-feet": f"stream MADE/short_left.csv MADE/short_right.csv --mount feet {rest}",
        "stream-pocket": f"stream MADE/pocket/recording.csv --mount pocket {rest}",
        "stream-damaged": f"stream MADE/damaged.csv {rest}",
    }
    goldens = [Golden(name, words) for name, words in runs.items()]
    goldens += [Golden("stream-killed", f"stream MADE/short.csv --record record.csv --resume {rest}", killed=True)]
    for words in (
        "--method nobody",
        "--gate nobody",
        "--heading nan",
        "--set smoother.nothing=1",
        "--mount hat",
        "--rate 0",
    ):
        goldens.append(Golden(f"refused-{words.replace(' ', '')}", f"run MADE/short.csv {words}"))
    goldens += [
        Golden(f"refused-{path.name}", f"run MADE/refused/{path.name}") for path in sorted((made / "refused").iterdir())
    ]
    for folder, word in ((data / "formats", "DATA/formats"), (data.parent / "cases", "CASES")):
        for path in sorted(folder.iterdir()) if folder.is_dir() else []:
            files = (
                sorted(p for p in path.rglob("*") if p.is_file() and p.name != "README.txt") if path.is_dir() else []
            )
            for file in files:
                name = file.relative_to(folder).as_posix()
                goldens.append(Golden(f"read-{name.replace('/', '+')}", f"inspect '{word}/{name}'"))
    return goldens


def make_inputs(data: Path, made: Path) -> None:
    """Write the simulated walks, a fix, and damaged tables."""
    square, lap = (str(data / "mems_foot" / name) for name in ("square_70m_2.csv.gz", "lap_360m_1.csv.gz"))
    commands = [
        "simulate office --seed 3 --out office",
        "simulate office --seed 5 --both-feet --out both",
        "simulate demo --worn pocket --out pocket",
        "simulate demo --seed 2 --out demo",
        f"convert {square} square.csv",
        f"run {lap} --save-places places.npz --plots none --out lap",
    ]
    for command in commands:
        code, _, err = run_command([*command.split(), "--quiet"], made)
        if code:
            raise SimulationError(f"`fg-nav {command}` failed: {err}")
    rows = (made / "demo" / "recording.csv").read_text().splitlines(keepends=True)
    short = rows[:9001]
    (made / "short.csv").write_text("".join(short))
    for side in ("left", "right"):
        both = (made / "both" / f"{side}.csv").read_text().splitlines(keepends=True)
        (made / f"short_{side}.csv").write_text("".join(both[:8001]))
    last = np.loadtxt(data / "mtig710/2022_1_14_stair_walk_up_foot1.csv.gz", delimiter=",", skiprows=1, usecols=0)[-1]
    (made / "fixes.csv").write_text(f"time_s,x_m,y_m,z_m,sigma_m\n{last - 1.0:.3f},2.0,-3.0,8.0,0.3\n")

    # rows lost, swapped, repeated, spoiled: what a stream goes on through
    damaged = (
        short[:2000]
        + short[2600:4000]
        + short[4100:4000:-1]
        + short[4100:5000] * 2
        + ["1,2,3\n", "noise\n"]
        + short[5000:]
    )
    (made / "damaged.csv").write_text("".join(damaged))

    # tables that cannot be navigated
    def change(columns: Sequence[int], factor: float, offset: float = 0.0) -> str:
        table = [row.rstrip("\n").split(",") for row in short]
        for row in table[1:]:
            for c in columns:
                row[c] = row[c] and f"{float(row[c]) * factor + offset:.9g}"
        return "".join(",".join(row) + "\n" for row in table)

    refused = made / "refused"
    refused.mkdir()
    tables = {
        "empty.csv": "",
        "header_only.csv": short[0],
        "no_header.csv": "".join(short[1:]),
        "ten_rows.csv": "".join(short[:11]),
        "backwards.csv": short[0] + "".join(short[:0:-1]),
        "same_stamp.csv": change([0], 0.0),
        "in_g.csv": change([1, 2, 3], 1 / 9.81),
        "in_degrees.csv": change([4, 5, 6], 180 / np.pi),
        "no_gravity.csv": change([3], 0.02),
        "milliseconds.csv": change([0], 1000.0),
        "in_tesla.csv": change([7, 8, 9], 1e-6),
        "cut_row.csv": "".join(short)[:-30],
        "words.csv": "".join(short[:500]) + "a,b,c,d,e,f,g,h,i,j\n" + "".join(short[500:]),
        "two_headers.csv": "".join(short[:500] + short[:1] + short[500:]),
        "lies_still.csv": short[0] + "".join(f"{k / 100},0,0,9.81,0,0,0,20,0,-40\n" for k in range(3000)),
    }
    for name, text in tables.items():
        (refused / name).write_text(text)
    (refused / "noise.bin").write_bytes(np.random.default_rng(1).bytes(4000))


def run_command(words: Sequence[str], folder: Path) -> tuple[int, str, str]:
    """Run `fg-nav` in this process, or a stream, which has threads, in another; return exit code and both outputs."""
    if words[0] == "stream":
        ran = subprocess.run([sys.executable, "-m", "fg_nav.cli", *words], cwd=folder, capture_output=True, text=True)
        return ran.returncode, ran.stdout, ran.stderr
    return call(words, folder)


def kill_amid(words: Sequence[str], folder: Path) -> None:
    """Run `fg-nav stream -` on half of the rows, and kill it once they are read and recorded."""
    source = next(word for word in words if word.endswith(".csv"))
    rows = Path(source).read_bytes().splitlines(keepends=True)
    command = [sys.executable, "-m", "fg_nav.cli", *("-" if word == source else word for word in words)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, cwd=folder)
    assert process.stdin is not None
    for k in range(0, len(rows) // 2, 100):
        process.stdin.write(b"".join(rows[k : k + 100]))
        process.stdin.flush()
        time.sleep(0.02)
    deadline = time.monotonic() + 20.0
    while not (folder / "record.csv").exists() and time.monotonic() < deadline:
        time.sleep(0.1)
    time.sleep(1.0)
    process.send_signal(signal.SIGKILL)
    process.wait()


@dataclass(frozen=True)
class Job:
    """A golden and the folders of its inputs and of what it leaves."""

    golden: Golden
    data: Path
    made: Path
    kept: Path


def run_golden(job: Job) -> str:
    """Run one golden and keep what it leaves, without times and folders; return its name."""
    golden = job.golden
    kept = job.kept / golden.name
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        places = {"DATA": job.data, "CASES": job.data.parent / "cases", "MADE": job.made}
        words = [
            re.sub(r"^(DATA|CASES|MADE)(?=/)", lambda m: str(places[m[0]]), word) for word in shlex.split(golden.words)
        ]
        if golden.killed:
            kill_amid(words, folder)
        code, out, err = run_command(words, folder)
        texts = {"exit": f"{code}\n", "stdout": out, "stderr": err}
        for path in sorted(folder.rglob("*")):
            if path.is_file() and (path.suffix in KEPT or (path.suffix == ".html" and golden.name in PAGES)):
                texts[path.relative_to(folder).as_posix()] = path.read_text(encoding="utf-8")
        shutil.rmtree(kept, ignore_errors=True)
        for name, text in texts.items():
            for word, where in (("HERE", folder), *places.items()):
                text = text.replace(str(where), word)
            if golden.killed and name in ("stdout", "stderr"):  # lines before the kill depend on when it came
                text = "".join(line for line in text.splitlines(keepends=True) if '"smoothed"' in line)
            (kept / name).parent.mkdir(parents=True, exist_ok=True)
            (kept / name).write_text(text, encoding="utf-8")
    return golden.name


def compare_text(old: str, new: str) -> Iterator[str]:
    """Yield lines that differ in their words, or in a number by more than the tolerance."""
    for number, (one, other) in enumerate(zip_longest(old.splitlines(), new.splitlines(), fillvalue=""), 1):
        if one == other or (TIMED.search(one) and TIMED.search(other)):
            continue
        numbers, others = NUMBER.findall(one), NUMBER.findall(other)
        apart = 0.0
        if NUMBER.sub("#", one) == NUMBER.sub("#", other):
            for a, b in zip(numbers, others, strict=True):
                allowed = TOLERANCE * max(1.0, abs(float(b))) + max(map(find_last_digit, (a, b)))
                difference = abs(float(a) - float(b))
                apart = max(apart, difference if difference > allowed else 0.0)
            if not apart:
                continue
        yield f"line {number}{f', by {apart:.2g}' if apart else ''}:\n      - {one[:300]}\n      + {other[:300]}"


def find_last_digit(number: str) -> float:
    """Return the unit of a printed number's last digit, below a whole one."""
    mantissa, _, exponent = number.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals else 0.0


def read_untimed(path: Path) -> str:
    """Return the text of a file; of a table without its columns of times of computing."""
    text = path.read_text(encoding="utf-8")
    names = text.partition("\n")[0].split(",")
    timed = {k for k, name in enumerate(names) if TIMED.search(name)}
    if path.suffix != ".csv" or not timed:
        return text
    rows = (row.split(",") for row in text.splitlines())
    return "\n".join(",".join(cell for k, cell in enumerate(row) if k not in timed) for row in rows)


def compare_folders(old: Path, new: Path) -> list[str]:
    """List the files of one golden that differ, with their first differing lines."""
    found = []
    files = [{p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()} for folder in (old, new)]
    for name in sorted(files[0] | files[1]):
        if name not in files[0] or name not in files[1]:
            found.append(f"  {name}: {'gone' if name in files[0] else 'new'}")
            continue
        lines = list(compare_text(*(read_untimed(folder / name) for folder in (old, new))))
        if lines:
            shown = "\n    ".join(lines[:MAX_SHOWN])
            found.append(f"  {name}: {len(lines)} lines differ\n    {shown}")
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Keep or compare."""
    chosen = harness.parse_arguments(
        __doc__,
        arguments,
        what=option("compare", "keep or compare", choices=("keep", "compare"), positional=True),
        folder=option(None, "folder of the goldens", type=Path, positional=True),
        only=option((), "words in their names", nargs="*", metavar="WORD"),
        data=None,
        jobs=2,
    )
    data, folder, keeps = walks.data_folder(chosen.data), chosen.folder.resolve(), chosen.what == "keep"
    made = folder / "made"
    if keeps and not made.exists():
        made.mkdir(parents=True)
        make_inputs(data, made)
    goldens = [g for g in list_goldens(data, made) if not chosen.only or any(word in g.name for word in chosen.only)]
    with tempfile.TemporaryDirectory() as place:
        kept = folder / "kept" if keeps else Path(place)
        harness.map_walks(run_golden, [Job(golden, data, made, kept) for golden in goldens], chosen.jobs, "goldens")
        if keeps:
            print(f"{len(goldens)} goldens kept in {folder}")
            return
        differing = {
            g.name: found for g in goldens if (found := compare_folders(folder / "kept" / g.name, kept / g.name))
        }
    for name, found in differing.items():
        print(name, *found, sep="\n")
    print(f"{len(goldens) - len(differing)} of {len(goldens)} goldens equal")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
