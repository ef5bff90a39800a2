"""Reading scenes: YAML with its lines, and checks of the whole."""
