"""Columns of a table, wherever it stands: which is what, in which unit.

======== ==================================================================
units    unit words become factors
headers  what the name of one column says
choice   which columns of a table to take, by their names
mapping  the same, as the user says it (`--columns`)
samples  columns become samples in SI; units that are not said are judged
======== ==================================================================

It knows no files: `fg_nav.io` reads tables by it, `Recording.from_dataframe` and the rows of a stream use it too.
"""
