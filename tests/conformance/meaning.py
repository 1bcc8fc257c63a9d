"""Which tests hold the meaning of which fields: meaning.toml, read."""

import tomllib
from fnmatch import fnmatchcase
from pathlib import Path

MEANING: dict[str, list[str]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text())


def pattern_of(name: str) -> str | None:
    """Find the first pattern that fits."""
    return next((pattern for pattern in MEANING if fnmatchcase(name, pattern)), None)


def held_by(name: str) -> list[str]:
    """Name the tests that hold the meaning of a field or call."""
    pattern = pattern_of(name)
    return [] if pattern is None else MEANING[pattern]
