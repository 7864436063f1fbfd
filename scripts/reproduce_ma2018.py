"""All experiments of a paper from a checkout: as `fg-nav reproduce ma2018`, with the rows printed and nothing else.

    python scripts/reproduce_ma2018.py --out DIR [--seeds N] [--jobs N] [--quick]

What is kept in DIR from an earlier run is taken up, and so are the files of `compare_ekf.py` in its folder `cells`.
"""

from __future__ import annotations

from collections.abc import Sequence

import figures as fig
from reproduced import reproduced

from fg_nav.reproduce.ma2018 import reproduce


def main(arguments: Sequence[str] | None = None) -> None:
    """Make, print."""
    reproduced(reproduce, arguments)


if __name__ == "__main__":
    fig.leave_with(main)
