"""Simulated robots and generated sites."""
