"""What people get to see: result folders, files, tables and pictures.

Imported by the command line, the papers' experiments and scripts only. Importing this package does
not import matplotlib; `fg_nav.report.plots` does.
"""
