"""Files in, files out: one reader per recording format, truth readers, and the writers.

`read` is the usual way in; it recognizes the format from the content. `read_raw` gives the same unchecked, for
inspection of broken files. What is missing, damaged or ambiguous in a file is a `FormatError`: in one sentence the
file, the line or column, and what to try.
"""

from fg_nav.io.beside import read_fixes, read_gnss
from fg_nav.io.formats import FORMATS, Format, Reading, read, read_raw, read_truth
from fg_nav.io.writing import write_canonical, write_tum

__all__ = [
    "FORMATS", "Format", "Reading", "read", "read_fixes", "read_gnss",
    "read_raw", "read_truth", "write_canonical", "write_tum",
]  # fmt: skip
