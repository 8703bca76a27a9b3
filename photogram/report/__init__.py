"""Numbers and pictures of a finished survey."""
