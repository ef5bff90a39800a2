"""Bodies as points."""
