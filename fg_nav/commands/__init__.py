"""The verbs of the command line, a page each: `requests` has what each is asked, `shared` what they have in common.

Each verb checks what it can before the work, works, writes into a folder that appears whole or not at all, and returns
an `Answer`, which the command line prints.
"""
