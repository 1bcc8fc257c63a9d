"""What can be asked about: read models, queries, analytics."""
