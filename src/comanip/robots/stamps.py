"""The stamps of another machine on this one's clock.

No clock is synchronised: what is known of a message is when it was stamped there and when it came here. The least difference of
the two that was seen lately is how far the clocks are apart (and the fastest way of a message, which nobody can tell from it);
what a message took longer than that is its age.
"""

from __future__ import annotations

from math import inf, isnan

WINDOW_S = 10.0  # in which the least difference is sought: clocks drift by 50 us a second
BACK_S = 1.0  # a stamp that goes back by less overtook another message; by more: the clock there was set, or its node restarted


class Arrivals:
    """One topic's. Times never go back: what is later in order is not earlier in time."""

    def __init__(self) -> None:
        self._start()
        self._last = -inf

    def _start(self) -> None:
        self._least, self._before, self._since, self._stamp = inf, inf, -inf, -inf

    def time(self, stamp: float, now: float) -> float | None:
        """When a message stamped `stamp` [s] there, and heard `now` here, was made, on this machine's clock.

        A message without a stamp (NaN) was made when it came. None: it is no later than one that was here before it.
        """
        if isnan(stamp):
            self._last = max(self._last, now)
            return self._last
        if stamp <= self._stamp:
            if self._stamp - stamp < BACK_S:
                return None
            self._start()
        self._stamp, apart = stamp, now - stamp
        if now - self._since > WINDOW_S:
            self._before, self._least, self._since = self._least, apart, now
        self._least = min(self._least, apart)
        self._last = max(self._last, stamp + min(self._least, self._before))
        return self._last
