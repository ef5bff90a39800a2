"""Runnable example scenes."""
