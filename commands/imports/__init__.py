"""Scene files of other systems, translated to ours."""
