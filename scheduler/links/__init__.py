"""How robots are talked to."""
