"""Any past moment: state, recordings, the console."""
