"""Convert dates and clock times in a text file's column to seconds after the first."""

from __future__ import annotations

import re
from datetime import datetime, timedelta
from typing import Any

DAY = 86400.0
# A clock time, with or without a date.
CLOCK_TIME = re.compile(
    r"(?:(?P<date>\d[\d./-]{5,9}\d)(?:T|,?\s+))?(?P<clock>\d{1,2}:\d{2}(?::\d{2})?)"
    # The fraction is parsed here, since Python reads microseconds only and some loggers write
    # nanoseconds.
    r"(?:[.,](?P<fraction>\d+))?\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|[+-]\d{2}:?\d{2})?"
)
ISO_DATE = re.compile(r"\d{4}-\d{2}-\d{2}|\d{8}")


class StampReader:
    """Parse the time stamps of one column, from the first to the last.

    They follow ISO 8601 (2026-03-01T12:00:00.005Z), or are clock times (12:00:00.005, or 00:00.005
    for minutes and seconds) without a date or with a constant date. A clock time without a date
    that decreases by half a day or more has passed midnight.

    Examples
    --------
    >>> reader = StampReader()
    >>> [reader.seconds(text) for text in ("23:59:59.5", "00:00:00.25")]
    [0.0, 0.75]
    """

    def __init__(self) -> None:
        self._first: tuple[Any, float] | None = None
        self._date: str | None = None
        self._clock, self._days = 0.0, 0

    def seconds(self, text: str) -> float:
        """Seconds after the first stamp; NaN if the text is not a time stamp.

        Raises ValueError if zones are mixed, or if dates change that do not follow ISO 8601.
        """
        match = CLOCK_TIME.fullmatch(text.strip())
        if match is None:
            return float("nan")
        clock, fraction = _clock(match), float(f"0.{match['fraction'] or 0}")
        date = match["date"] or ""
        moment: Any
        if ISO_DATE.fullmatch(date):
            midnight = datetime.fromisoformat(f"{date}T00:00:00{match['zone'] or ''}")
            moment = midnight + timedelta(seconds=clock)
        else:
            moment = timedelta(seconds=self._on_one_day(date, clock))
        if self._first is None:
            self._first = moment, fraction
        try:
            passed = moment - self._first[0]
        except TypeError:
            raise ValueError(
                "only some of its time stamps have a time zone: write all with or without it"
            ) from None
        return passed.total_seconds() + (fraction - self._first[1])

    def _on_one_day(self, date, clock):
        """Seconds since the first midnight."""
        if self._date not in (None, date):
            raise ValueError(
                f"its dates change ({self._date}, {date}), but the order of day and month "
                "is unknown: write ISO 8601 (2026-03-01T12:00:00.005), or seconds"
            )
        if not date and self._clock - clock > 0.5 * DAY:
            self._days += 1
        self._date, self._clock = date, clock
        return self._days * DAY + clock


def _clock(match):
    """Clock time in whole seconds after midnight."""
    parts = [int(part) for part in match["clock"].split(":")]
    if len(parts) == 2:
        # 00:00.005 means minutes and seconds, 12:30 hours and minutes.
        parts = [0, *parts] if match["fraction"] else [*parts, 0]
    hours, minutes, seconds = parts
    half = (match["half"] or "").lower()[:1]
    hours = hours % 12 + (12 if half == "p" else 0) if half else hours
    return 3600 * hours + 60 * minutes + seconds
