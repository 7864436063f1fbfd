"""Simulated walks with a truth that is exact: so far one small built-in demonstration (`demo_walk`)."""

from fg_nav.simulation.demo import demo_walk

__all__ = ["demo_walk"]
