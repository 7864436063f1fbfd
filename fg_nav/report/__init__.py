"""What people get to see: result folders, tables and pictures.

Imported by the command line and by scripts only. Importing this package does not import matplotlib;
`fg_nav.report.pictures` does.
"""
