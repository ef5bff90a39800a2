"""Mohr-Coulomb soil for periporo."""
