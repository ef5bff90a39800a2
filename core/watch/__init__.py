"""What looks at a run: histories, health, signals, timing, and the state that is kept."""
