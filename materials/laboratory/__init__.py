"""One material point driven along a path."""
