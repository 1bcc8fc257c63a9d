"""The write side of each API dialect."""
