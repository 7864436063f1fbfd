"""The papers' experiments beside ours, from simulated walks: figures, tables and a page for each paper."""
