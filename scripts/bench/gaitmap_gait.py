"""Run gaitmap on the strides of a foot: started by `experiments/gait.py` with the interpreter in which it is installed.

    PYTHON scripts/bench/gaitmap_gait.py SAMPLES SENSOR < strides.csv > parameters.csv

`SAMPLES` is a table as gaitmap's sample, in its axes and units; of strides the samples `start` and `end`, in stance,
`pre_ic`, `tc` and `ic`. Of its trajectory of each stride with all defaults come length, lift of the sensor and turn,
clockwise, by our names. Nothing of fg-nav is imported.
"""

import sys

import numpy as np
import pandas as pd

if __name__ == "__main__":
    from gaitmap.parameters import SpatialParameterCalculation
    from gaitmap.trajectory_reconstruction import StrideLevelTrajectory

    rate_hz = 204.8
    samples = pd.read_csv(sys.argv[1], header=[0, 1], index_col=0)[sys.argv[2]]
    strides = pd.read_csv(sys.stdin)
    strides = strides.assign(s_id=np.arange(len(strides)), min_vel=strides.start)
    path = StrideLevelTrajectory().estimate(samples, strides, sampling_rate_hz=rate_hz)
    found = SpatialParameterCalculation().calculate(strides, path.position_, path.orientation_, rate_hz).parameters_
    found = found.assign(turning_angle=-found.turning_angle).rename(
        columns={"stride_length": "length_m", "max_sensor_lift": "clearance_m", "turning_angle": "turning_deg"}
    )
    found[["length_m", "clearance_m", "turning_deg"]].to_csv(sys.stdout, index=False)
