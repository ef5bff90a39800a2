"""Points, bonds, domain decomposition and the time loop."""
