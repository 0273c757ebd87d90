"""`harvester cite`: the sources of the methods, of all or of those that a result used."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from harvester.errors import HarvesterError
from harvester.signatures import File

# Most bytes that are read, since a device such as /dev/zero never ends.
LARGEST_RESULT = 100_000_000


def cite(result: File | None = None, /) -> None:
    """The sources of the methods that a result used.

    Parameters
    ----------
    result : str or None
        JSON of simulate, average or validate (default: the sources of all methods).
    """
    from harvester.commands.citations import SOURCES, sources_of

    found: Sequence = SOURCES
    if result:
        try:
            found = sources_of(_read(result))
        except HarvesterError as error:
            raise HarvesterError(f"{result}: {error}") from None
    for source in found:
        print(f"{source.method}:\n    {source.reference}")


def _read(name):
    try:
        with Path(name).open("rb") as file:
            content = file.read(LARGEST_RESULT + 1)
        if len(content) > LARGEST_RESULT:
            raise HarvesterError(f"is larger than {LARGEST_RESULT // 10**6} MB: no result")
        return json.loads(content)
    except OSError as error:
        raise HarvesterError(
            f"cannot be read: {error.strerror}; give a file that --json or --output wrote"
        ) from None
    except (ValueError, RecursionError):
        raise HarvesterError("is no JSON; give a file that --json or --output wrote") from None
