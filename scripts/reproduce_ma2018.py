"""The results of Ma et al. (2018) beside ours, each printed figure with a verdict.

    python scripts/reproduce_ma2018.py [--quick] [--seeds N] [--first SEED] [--workers N] [--out DIR] [--force]

The same as `fg-nav reproduce ma2018` with the same options; how it is done stands in `fg_nav.lab.reproduce`.
"""

import sys

from fg_nav.cli import main

if __name__ == "__main__":
    sys.argv[1:1] = ["reproduce", "ma2018"]
    main()
