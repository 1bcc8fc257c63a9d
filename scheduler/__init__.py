"""What happens next: dispatch, traffic, robot links."""
