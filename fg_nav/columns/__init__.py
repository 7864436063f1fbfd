"""Columns of tables and streams: `headers` reads names and units, `mapping` chooses, `samples` converts to SI.

A column or unit that is missing, not known or leaves a choice is a `FormatError`, with the option to type.
"""
