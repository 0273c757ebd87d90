"""Load netlists: the `.lib` files of netlists/, as text."""

from __future__ import annotations

from importlib import resources


def library_text(name: str) -> str:
    """Text of netlists/<name>.lib without its comments, ending with a newline."""
    text = resources.files("netlists").joinpath(f"{name}.lib").read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("*")]
    return "\n".join(lines) + "\n"
