"""The read side of each API dialect."""
