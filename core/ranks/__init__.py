"""Ranks: who owns which points, copies of others' points, and sums over all."""
