"""Loads and conditions that a scene puts on points."""
