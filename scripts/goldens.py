"""Golden results of the command line: kept before a change of the code's structure, compared after it.

    python scripts/goldens.py keep|compare DIR [--only WORD ...] [--data DIR] [--jobs N]

`keep` runs the commands below and keeps, in a folder outside the repository, their exit codes, both outputs and the
files of their results. `compare` runs them again and names each line that differs; it exits with 1 if one does. With
`--only` the commands whose names contain one of the words.

Compared are words, byte for byte, and numbers, to `TOLERANCE` and one unit of their last printed digit; left out are
times of computing, the folder's name, pictures and pages.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path

import harness
import numpy as np
import walks
from fuzz.cases import call
from harness import option

TOLERANCE = 2e-9  # m, rad and everything else, and relative: results are printed with nine digits
KEPT = {".json", ".csv", ".tum", ".jsonl", ".geojson", ".kml"}
TIMED = re.compile(
    r"runtime|real.?time|busy|latenc|processor|created|generated|_ms\"|fg-nav \d|no sample has come|came again"
)
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MAX_SHOWN = 3  # differing lines of a file

MADE = """
simulate office --seed 3 --out office
simulate office --seed 5 --both-feet --out both
simulate demo --worn pocket --out pocket
simulate demo --seed 2 --out demo
convert DATA/mems_foot/square_70m_2.csv.gz square.csv
run DATA/mems_foot/lap_360m_1.csv.gz --save-places places.npz --plots none --out lap
"""
RUNS = """
run-demo: demo
run-office: run MADE/office/recording.csv --truth MADE/office/truth.tum
run-square-barometer: run DATA/mems_foot/square_70m_1.csv.gz --barometer DATA/mems_foot/square_70m_1.baro.csv.gz
run-gdin: run DATA/gdin/own/SensorConnectData_33.csv
run-gdin-no-mag: run DATA/gdin/own/SensorConnectData_40.csv --no-mag
run-gdlbio: run DATA/gdlbio/SensorConnectData_60_GDLBIO.mat
run-vicon: run DATA/vicon/2017-11-22-11-26-05.mat DATA/vicon/2017-11-27-11-14-52.mat
run-stairs-fixes: run DATA/mtig710/2022_1_14_stair_walk_up_foot1.csv.gz --fixes MADE/fixes.csv
run-gnss: run DATA/pocket_gnss/pocket_pace_01_004.zip --mount pocket --gnss own
run-on-places: run DATA/mems_foot/lap_360m_2.csv.gz --places MADE/places.npz
run-online: run MADE/short.csv --method online --polish
run-feet-simulated: run MADE/both/left.csv MADE/both/right.csv --mount feet
run-feet-real: run DATA/feet_2min/good_leftfoot.csv.gz DATA/feet_2min/good_rightfoot.csv.gz --mount feet
run-pocket-real: run DATA/pocket_gnss/pocket_walk_03_005.zip --mount pocket
run-pocket-simulated: run MADE/pocket/recording.csv --mount pocket
run-pocket-online: run MADE/pocket/recording.csv --mount pocket --method online
run-munoz-diaz: run MADE/pocket/recording.csv --mount pocket --method munoz-diaz2017
compare-gdin: compare DATA/gdin/own/SensorConnectData_36.csv
calibrate: calibrate MADE/office/recording.csv --out out.json
detect: detect MADE/short.csv
inspect-office: inspect MADE/office/recording.csv
stream-whole: stream MADE/short.csv --polish
stream-lag: stream MADE/short.csv --heading 0 --lag 15
stream-square: stream MADE/square.csv
stream-feet: stream MADE/short_left.csv MADE/short_right.csv --mount feet
stream-pocket: stream MADE/pocket/recording.csv --mount pocket
stream-damaged: stream MADE/damaged.csv
"""
FILTERS = ("iez", "qsf", "qsf-stance", "iqsf", "ma2018", "aiez", "matched")
PRESETS = ("tuned", "physical", "as-printed")
WRONG = ("--method nobody", "--gate nobody", "--heading nan", "--set smoother.nothing=1", "--mount hat", "--rate 0")


def list_goldens(data: Path) -> dict[str, str]:
    """List commands by name; `DATA/`, `CASES/` and `MADE/` stand for the folders of recordings."""
    runs = dict(line.split(": ", 1) for line in RUNS.strip().splitlines())
    for method in FILTERS:
        for words in (f"{method}-rts", *(f"{method} --preset {preset}" for preset in PRESETS)):
            runs[f"filter-{words.replace(' --preset ', '-')}"] = f"run MADE/short.csv --method {words}"
    for name, words in runs.items():
        ends = " --silence 0.3" if words.startswith("stream") else ""
        ends += " --plots none" if words.startswith(("run", "stream")) else ""
        ends += "" if words.startswith(("inspect", "calibrate")) else " --out out"
        runs[name] = words + ends
    runs |= {f"refused-{words.replace(' ', '')}": f"run MADE/short.csv {words}" for words in WRONG}
    for folder, word in ((data / "formats", "DATA/formats"), (data.parent / "cases", "CASES")):
        for file in sorted(path for path in folder.glob("*/**/*") if path.is_file() and path.name != "README.txt"):
            name = file.relative_to(folder).as_posix()
            runs[f"read-{name.replace('/', '+')}"] = f"inspect '{word}/{name}'"
    return runs


def make_inputs(data: Path, made: Path) -> None:
    """Write the simulated walks, a fix, and tables that a stream goes on through."""
    made.mkdir(parents=True)
    for command in MADE.strip().splitlines():
        code, _, err = call([*command.replace("DATA", str(data)).split(), "--quiet"], made)
        assert code == 0, f"`fg-nav {command}` failed: {err}"
    shortened = (("", "demo/recording", 9001), ("_left", "both/left", 8001), ("_right", "both/right", 8001))
    for name, source, rows in shortened:
        lines = (made / f"{source}.csv").read_text().splitlines(keepends=True)[:rows]
        (made / f"short{name}.csv").write_text("".join(lines))
    short = (made / "short.csv").read_text().splitlines(keepends=True)
    damaged = short[:2000] + short[2600:4000] + short[4100:4000:-1] + short[4100:5000] * 2
    (made / "damaged.csv").write_text("".join([*damaged, "1,2,3\n", "noise\n", *short[5000:]]))
    last = np.loadtxt(data / "mtig710/2022_1_14_stair_walk_up_foot1.csv.gz", delimiter=",", skiprows=1, usecols=0)[-1]
    (made / "fixes.csv").write_text(f"time_s,x_m,y_m,z_m,sigma_m\n{last - 1.0:.3f},2.0,-3.0,8.0,0.3\n")


def run_golden(data: Path, made: Path, folder: Path, golden: tuple[str, str]) -> None:
    """Run one command in an empty folder, a stream in a process of its own; keep what it leaves, without folders."""
    command, kept = golden[1], folder / golden[0]
    places = {"DATA": str(data), "CASES": str(data.parent / "cases"), "MADE": str(made)}
    words = [re.sub(r"^(DATA|CASES|MADE)(?=/)", lambda m: places[m[0]], word) for word in shlex.split(command)]
    with tempfile.TemporaryDirectory() as place:
        if words[0] == "stream":
            line = [sys.executable, "-m", "fg_nav", *words]
            done = subprocess.run(line, cwd=place, capture_output=True, text=True, check=False)
            answer = done.returncode, done.stdout, done.stderr
        else:
            answer = call(words, Path(place))
        texts = dict(zip(("code", "stdout", "stderr"), map(str, answer), strict=True))
        for path in sorted(Path(place).rglob("*")):
            if path.suffix in KEPT:
                texts[path.relative_to(place).as_posix()] = path.read_text(encoding="utf-8")
    shutil.rmtree(kept, ignore_errors=True)
    for file, text in texts.items():
        for word, where in {"HERE": place, **places}.items():
            text = text.replace(where, word)
        (kept / file).parent.mkdir(parents=True, exist_ok=True)
        (kept / file).write_text(text, encoding="utf-8")


def compare_texts(old: str, new: str, is_table: bool) -> Iterator[str]:
    """Yield lines that differ in their words, or in a number by more than the tolerance; times are left out."""
    timed = {k for k, name in enumerate(old.partition("\n")[0].split(",")) if is_table and TIMED.search(name)}
    for row, lines in enumerate(zip_longest(old.splitlines(), new.splitlines(), fillvalue=""), 1):
        one, other = (",".join(c for k, c in enumerate(line.split(",")) if k not in timed) for line in lines)
        if one == other or (TIMED.search(one) and TIMED.search(other)):
            continue
        apart = np.inf
        if NUMBER.sub("#", one) == NUMBER.sub("#", other):
            apart = 0.0
            for a, b in zip(NUMBER.findall(one), NUMBER.findall(other), strict=True):
                units = (m.lower().partition("e") for m in (a, b) if "." in m)  # of the last digit, below a whole one
                unit = sum(10.0 ** (int(e or 0) - len(mantissa.partition(".")[2])) for mantissa, _, e in units)
                off = abs(float(a) - float(b))
                apart = max(apart, off if off > TOLERANCE * max(1.0, abs(float(b))) + unit else 0.0)
        if apart:
            yield f"line {row}, by {apart:.2g}:\n      - {one[:300]}\n      + {other[:300]}"


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
    data, folder = walks.data_folder(chosen.data).resolve(), chosen.folder.resolve()
    made = folder / "made"
    if chosen.what == "keep" and not made.exists():
        make_inputs(data, made)
    goldens = {n: c for n, c in list_goldens(data).items() if not chosen.only or any(w in n for w in chosen.only)}
    with tempfile.TemporaryDirectory() as place:
        kept = folder / "kept" if chosen.what == "keep" else Path(place)
        harness.map_walks(partial(run_golden, data, made, kept), goldens.items(), chosen.jobs, "goldens")
        differing = set[str]()
        for golden in goldens if chosen.what == "compare" else ():
            both = folder / "kept" / golden, kept / golden
            for name in sorted({p.relative_to(f) for f in both for p in f.rglob("*") if p.is_file()}):
                old, new = ((one / name).read_text() if (one / name).exists() else "" for one in both)
                if lines := list(compare_texts(old, new, name.suffix == ".csv")):
                    differing.add(golden)
                    print(f"{golden}, {name}: {len(lines)} lines differ", *lines[:MAX_SHOWN], sep="\n    ")
    equal = len(goldens) - len(differing)
    print(f"{len(goldens)} kept in {folder}" if chosen.what == "keep" else f"{equal} of {len(goldens)} goldens equal")
    sys.exit(1 if differing else 0)


if __name__ == "__main__":
    main()
