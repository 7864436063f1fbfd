"""Where the real recordings are, for the tests that need them."""

import os
from pathlib import Path

import pytest

_CANDIDATE = Path(os.environ.get("FG_NAV_DATA", Path(__file__).parents[2] / "shared" / "data"))

DATA = _CANDIDATE if _CANDIDATE.is_dir() else None

needs_data = pytest.mark.skipif(
    DATA is None, reason="the real recordings are not here: set FG_NAV_DATA or put them at ../shared/data"
)

_CASES = Path(os.environ.get("FG_NAV_CASES", Path(__file__).parents[2] / "shared" / "cases"))

CASES = _CASES if _CASES.is_dir() else None

needs_cases = pytest.mark.skipif(
    CASES is None, reason="the small cases are not here: set FG_NAV_CASES or put them at ../shared/cases"
)
