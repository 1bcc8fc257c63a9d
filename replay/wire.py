"""What the console is sent, in general."""

from ledger.scene import Value


class Wire(Value, frozen=True, kw_only=True, rename="camel"):
    """Base of what the console is sent: names in camel case, as in every JSON of the server."""
