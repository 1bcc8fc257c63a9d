"""What happened: events, their meaning, and their storage."""
