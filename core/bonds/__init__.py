"""Bonds: the rows that carry stress and state, and their way through neighbour rebuilds."""
