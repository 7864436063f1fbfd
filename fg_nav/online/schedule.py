"""When a walk in progress is solved again, by the count of its footfalls alone.

======================== ==============================================================================================
the first footfalls      at once, each time all of the walk
then                     every n / 12, eight at least. The solution is taken over two footfalls later, and one more for
                         each 200 of the walk: one of n footfalls takes some n / 250 s, a footfall one second
behind `WHOLE_UNTIL`     what is known of sensor and foot does not change any more. Every `WINDOW` / 8 footfalls the
                         last `WINDOW` are solved again, from what was handed over before them; with a lag, those in it
a footfall in doubt      at once, from the last handover before it
the end                  once more
======================== ==============================================================================================
"""

from __future__ import annotations

AT_ONCE = (1, 2, 3, 4, 6, 8, 10)  # Footfalls at which all is solved at once: a tenth of a second.

WHOLE_UNTIL, WHOLE_WITH_LAG = 2000, 512
"""The last footfall at which all of a walk is solved; with a lag its samples are discarded behind it."""

WINDOW = 256  # Footfalls that are solved again behind it.
NEWEST = 20  # Footfalls that are looked at for one in doubt: those of the last 20 s, in which stances are searched.
DOUBT_DELAY = 3  # Footfalls behind which a walk is taken over that was solved again for one in doubt.


def is_windowed(n: int, has_lag: bool) -> bool:
    """Whether a walk of n footfalls is not solved as a whole any more."""
    return n > (WHOLE_WITH_LAG if has_lag else WHOLE_UNTIL)


def choose_next(n: int, has_lag: bool) -> int:
    """Return the footfall behind n, after the first ones, at which the walk is solved next."""
    return n + (WINDOW // 8 if is_windowed(n, has_lag) else max(8, n // 12))


def choose_delay(n: int, has_lag: bool) -> int:
    """Return how many footfalls behind n a solution of n footfalls is taken over."""
    return 2 + (WINDOW if is_windowed(n, has_lag) else n) // 200
