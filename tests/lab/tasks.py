"""Tasks for other processes, in a module that is quickly loaded there."""

import os
import time


def square(number):
    return number * number, os.getpid()


def slow(folder, number, seconds):
    """Take so long, and leave a file at the beginning and one at the end; "bad" fails."""
    (folder / f"{number}.begun").touch()
    if number == "bad":
        raise ValueError("bad")
    time.sleep(seconds)
    (folder / f"{number}.done").touch()


MINE = []


def list_of_mine():
    return MINE
