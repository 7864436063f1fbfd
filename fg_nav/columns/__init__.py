"""Columns of a table, wherever it stands: which is what, in which unit.

======== =======================================================================
headers  unit words become factors; what the name of one column says
mapping  which columns of a table to take, by their names or by `--columns`
samples  columns become samples in SI; units that are not said are judged
======== =======================================================================

It knows no files: `fg_nav.io` reads tables by it, `Recording.from_dataframe` and the rows of a stream use it too.
"""
