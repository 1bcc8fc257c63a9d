"""What the check of a scene says, in one form."""

from collections.abc import Sequence

from ledger.scene import Value

NAMED_MAX = 5  # names said in one sentence; the rest is counted


class Finding(Value, frozen=True, kw_only=True):
    """One thing found. `unusable`: no robot could be moved there as it is."""

    code: str
    words: str
    unusable: bool = False


def some(names: Sequence[str]) -> str:
    """List the first of these names."""
    if len(names) <= NAMED_MAX:
        return ", ".join(names)
    return f"{', '.join(names[:NAMED_MAX])} and {len(names) - NAMED_MAX} more"
