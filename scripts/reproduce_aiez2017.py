"""The results of Zhang et al. (2017) beside ours, each printed figure with a verdict.

    python scripts/reproduce_aiez2017.py [--quick] [--seeds N] [--first SEED] [--workers N] [--out DIR] [--force]

The same as `fg-nav reproduce aiez2017` with the same options; how it is done stands in `fg_nav.lab.reproduce`.
"""

import sys

from fg_nav.cli import main

if __name__ == "__main__":
    sys.argv[1:1] = ["reproduce", "aiez2017"]
    main()
