"""What a file that is no recording looks like, what it lacks, and what to type next."""

from __future__ import annotations

import codecs
import math
import shlex

from fg_nav.columns.headers import read_header
from fg_nav.columns.mapping import shorten_names
from fg_nav.errors import FormatError
from fg_nav.io.content import MEMBERS, Content
from fg_nav.io.readers import table
from fg_nav.io.readers.tables import explain_singles
from fg_nav.io.truth import CSV_COLUMNS

_MARKS = (
    (b"\xd0\xcf\x11\xe0", "an old Excel file: save it as CSV"),
    (b"SQLite format 3", "a database without topics of sensor_msgs/Imu: record these"),
    (b"%PDF", "a PDF: export the samples as CSV"),
    (b"\x89PNG", "a picture: give the recording"),
    (b"\xff\xd8\xff", "a picture: give the recording"),
    (codecs.BOM_UTF32_LE, "text in UTF-32: save it in UTF-8"),
    (codecs.BOM_UTF32_BE, "text in UTF-32: save it in UTF-8"),
    (b"BZh", "packed by bzip2: unpack it"),
    (b"\xfd7zXZ", "packed by xz: unpack it"),
    (b"\x28\xb5\x2f\xfd", "packed by zstd: unpack it"),
    (b"7z\xbc\xaf", "a 7z archive: unpack it"),
    (b"Rar!", "a RAR archive: unpack it"),
)

_FIXES = {"time_s", "x_m", "y_m", "sigma_m"}

_QUATERNION = slice(4, 8)


def explain_unknown(content: Content, count: int) -> str:
    """Say in one sentence what a content in none of `count` formats is nearest to, and what to do."""
    name = content.path.name
    if content.kind == MEMBERS:
        return _explain_table(content) or f"{name} is in none of the formats read here: {_explain_members(content)}."
    known = _explain_own(content) or _explain_mark(content)
    if known is not None:
        return f"{name} is no recording but {known}."
    nearest = _explain_table(content) or explain_singles([content])
    if nearest is not None:
        return nearest
    what = "text without a table of numbers" if content.lines else "a binary file of an unknown kind"
    return (
        f"{name} is in none of the {count} formats read here, but {what}: export its samples as a table with the "
        f"columns t,ax,ay,az,gx,gy,gz, and type fg-nav inspect {shlex.quote(str(content.path.with_suffix('.csv')))}."
    )


def _explain_own(content: Content) -> str | None:
    """Name a file that this project reads elsewhere: a truth, fixes, a calibration."""
    path = shlex.quote(str(content.path))
    if not set(CSV_COLUMNS).isdisjoint(content.fields()) and "stride" in content.fields():
        return f"footprints: give them as the truth, fg-nav run RECORDING --truth {path}"
    if set(content.fields()) >= _FIXES:
        return f"known positions: give them as fg-nav run RECORDING --fixes {path}"
    if any('"fg-nav calibration"' in line for line in content.lines[:20]):
        return f"a calibration: give it as fg-nav run RECORDING --calibration {path}"
    if _is_tum(content):
        return f"a true path (t x y z qx qy qz qw): give it as fg-nav run RECORDING --truth {path}"
    return None


def _is_tum(content: Content) -> bool:
    """Whether the first lines are stamps, positions and quaternions of length one."""
    rows = [line.split() for line in content.lines[:40] if line.strip() and not line.startswith("#")]
    try:
        numbers = [[float(field) for field in row] for row in rows[:20]]
    except ValueError:
        return False
    lengths = [math.hypot(*row[_QUATERNION]) for row in numbers]
    return bool(rows) and all(len(row) == 8 for row in rows[:20]) and all(abs(s - 1.0) < 5e-4 for s in lengths)


def _explain_mark(content: Content) -> str | None:
    if _is_unmarked_utf16(content.head):
        return "text in UTF-16 without a byte-order mark: save it in UTF-8"
    return next((words for mark, words in _MARKS if content.head.startswith(mark)), None)


def _is_unmarked_utf16(head: bytes) -> bool:
    """Whether every second byte is zero, and no other, as in Latin text."""
    return any(not any(head[zeros::2]) and all(head[1 - zeros :: 2]) for zeros in (0, 1)) and len(head) > 1


def _explain_members(content: Content) -> str:
    """Say what is in a folder or archive."""
    packed = next((place for place, part in content.members.items() if part.head.startswith(table.ZIP_MARK)), None)
    if packed is not None:
        return f"it holds an archive in itself, unpack it and give '{packed}'"
    kinds = {place: _find_kinds(part) for place, part in content.members.items()}
    some = [f"'{place}' has {' and '.join(sorted(found))}" for place, found in kinds.items() if found]
    if some:
        return (
            f"it is nearest to a table, but {', '.join(some[:4])}, none has both; "
            f"export both sensors into one file, or give that file"
        )
    return f"it holds {shorten_names(list(content.members), 6)}, of which none is a recording; give the one that is"


def _find_kinds(content: Content) -> set[str]:
    """Which of acceleration and angular rate the columns of a table name."""
    words = {"acc": "acceleration", "gyr": "angular rate", "no gravity": "acceleration without gravity"}
    try:
        opened = table.open_table(content, 3)
    except FormatError:
        return set()
    named = table.find_kinds(opened.names) if opened and opened.has_header else set()
    return {word for kind, word in words.items() if kind in named}


def _explain_table(content: Content) -> str | None:
    """Say what a table lacks to be read by its header; None if the content is no table."""
    try:
        opened = table.open_table(content)
        if opened is None:
            return None
        if content.variables and not _find_kinds(content):
            listed = shorten_names(sorted(content.variables), 8)
            return (
                f"{content.path.name} is no recording but a MATLAB file with the variables {listed}: save the samples "
                f"in arrays t (N,), acc (N, 3) and gyr (N, 3)."
            )
        unnamed = sum(read_header(name) is None for name in opened.names)
        if opened.has_header and unnamed < 3 and (single := explain_singles([content])):
            return single
        if not opened.has_header or _find_kinds(content):
            table.choose(content, opened)
    except FormatError as error:
        return str(error)
    return (
        f"{content.path.name} is nearest to a table, with the columns {shorten_names(opened.names, 12)}, of which none "
        f"names acceleration or angular rate: say which they are, {table.ask_by_numbers(content)}."
    )
