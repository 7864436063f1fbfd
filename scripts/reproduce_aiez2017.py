"""All experiments of a paper from a checkout: as `fg-nav reproduce aiez2017`, with the rows printed and nothing else.

    python scripts/reproduce_aiez2017.py --out DIR [--seeds N] [--jobs N] [--quick]

What is kept in DIR from an earlier run is taken up, and so are the files of `compare_ekf.py` in its folder `cells`.
"""

from __future__ import annotations

from collections.abc import Sequence

import figures as fig
from reproduced import reproduced

from fg_nav.reproduce.aiez2017 import reproduce


def main(arguments: Sequence[str] | None = None) -> None:
    """Make, print."""
    reproduced(reproduce, arguments)


if __name__ == "__main__":
    fig.leave_with(main)
