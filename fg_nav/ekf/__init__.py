"""Filters: the classic way, one pass forward at the sensor's rate."""

from fg_nav.ekf.iez import run_iez
from fg_nav.ekf.parameters import OPENSHOE, IezParameters

__all__ = ["OPENSHOE", "IezParameters", "run_iez"]
