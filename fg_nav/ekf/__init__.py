"""Filters: the classic way, one pass forward at the sensor's rate."""

from fg_nav.ekf.core import OPENSHOE, IezParameters, run_iez

__all__ = ["OPENSHOE", "IezParameters", "run_iez"]
