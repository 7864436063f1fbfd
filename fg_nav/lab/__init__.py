"""The laboratory: walks with a known truth, campaigns over many walks, and the papers' experiments."""
