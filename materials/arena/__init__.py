"""The Arena model of partially saturated sand and soil."""

from periporo.materials.arena.model import Arena

__all__ = ["Arena"]
