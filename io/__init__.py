"""Input schema, geometry, results, checkpoints, plots and the log."""
