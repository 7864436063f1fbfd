"""The results of Munoz Diaz et al. (2017) beside ours: what gravity and the field tell of gyro biases in a pocket.

    python scripts/reproduce_munoz_diaz2017.py [--quick] [--seeds N] [--first SEED] [--workers N] [--out DIR] [--force]

The same as `fg-nav reproduce munoz-diaz2017` with the same options; how it is done stands in `fg_nav.lab.reproduce`.
"""

import sys

from fg_nav.cli import main

if __name__ == "__main__":
    sys.argv[1:1] = ["reproduce", "munoz-diaz2017"]
    main()
