"""A source that sends nothing: said after some seconds, and the end of the walk where the user asks for it."""

from __future__ import annotations

import time

from fg_nav.online.outlets import Say


class Silence:
    """How long no sample has come from a source of that name.

    Silence of `stalled_s` is remarked; after `until_silent_s` the walk is over, None to wait for ever.
    """

    def __init__(self, name: str, stalled_s: float, until_silent_s: float | None, remark: Say) -> None:
        self._name, self._stalled_s, self._until_silent_s, self._remark = name, stalled_s, until_silent_s, remark
        self._since = time.monotonic()
        self._remarked = False

    def is_over(self, n_samples: int) -> bool:
        """Note how many samples have come; return whether the silence is so long that the walk is over."""
        now = time.monotonic()
        silent = now - self._since
        if n_samples:
            if self._remarked:
                self._remark(f"{self._name} sends again after {silent:.0f} s.")
            self._since, self._remarked = now, False
            return False
        if silent >= self._stalled_s and not self._remarked:
            self._remark(f"no sample has come from {self._name} for {silent:.0f} s: waiting.")
            self._remarked = True
        return self._until_silent_s is not None and silent >= self._until_silent_s
