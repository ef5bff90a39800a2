"""Constitutive laws, their protocol and their registry."""
