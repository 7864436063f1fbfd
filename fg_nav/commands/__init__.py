"""The verbs of the command line, a page each."""
