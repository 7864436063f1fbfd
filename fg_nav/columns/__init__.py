"""Columns of tables and streams: `headers` reads names and units, `mapping` chooses, `samples` converts to SI."""
