"""Options of `identify` that name measured files with their settings."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any

from harvester.base.errors import HarvesterError
from harvester.base.numbers import number
from harvester.base.plain_text import named
from harvester.base.signatures import Kind, pair_of


def files_of(words: list[str]) -> list[tuple[str, dict[str, Any]]]:
    """Parse files with their settings: words with = belong to the preceding file."""
    files: list[tuple[str, dict[str, Any]]] = []
    for word in words:
        if not files or "=" not in word:
            files.append((word, {}))
            continue
        name, value = pair_of(str)(word)
        if not name:
            raise ValueError(word)
        # Keys of the scene take numbers, columns take names.
        settings = files[-1][1]
        settings[name] = value
        with contextlib.suppress(ValueError):
            settings[name] = number(value) if "." in name else value
    return files


def together(lists: list[list[Any]], option: str) -> list[Any]:
    return [item for items in lists for item in items]


def records_of(lists: list[list[Any]], option: str) -> list[tuple[str, dict[str, Any]]]:
    """Files with their settings; raise HarvesterError if one is given twice."""
    seen: list[tuple[str, dict[str, Any]]] = []
    for file, settings in together(lists, option):
        # A file may have several names, such as shaker.csv, ./shaker.csv and a link.
        record = (os.path.realpath(file), settings)
        if record in seen:
            raise HarvesterError(
                f"{option} {named(file)}: is given twice with the same settings, but each record "
                "counts once: remove one"
            )
        seen.append(record)
    return together(lists, option)


def one_record_of(lists: list[list[Any]], option: str) -> tuple[str, dict[str, Any]]:
    """One file with its settings; raise HarvesterError if there are several."""
    record, *further = together(lists, option)
    if further:
        raise HarvesterError(
            f"{option} {named(further[0][0])}: give only one file, with NAME=VALUE"
        )
    return record


_FILE = Kind("FILE [SETTING=VALUE]", "written as FILE NAME=VALUE", read=files_of, words=True)
Records = Annotated[Any, replace(_FILE, option="record", join=records_of)]
KeptRecords = Annotated[Any, replace(_FILE, option="keep-aside", join=records_of)]
Keys = Annotated[Sequence[str], Kind("TABLE.KEY", read=list, join=together, words=True)]
Impedance = Annotated[Any, replace(_FILE, join=one_record_of)]
