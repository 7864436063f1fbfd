"""One module a recording format: whether a file is in it, and what the file says in SI units, unjudged."""
