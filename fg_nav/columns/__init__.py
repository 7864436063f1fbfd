"""Columns of a table, wherever it stands: what their headers and units say, without a file and without samples.

`units` has the unit words.
"""
