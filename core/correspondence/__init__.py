"""Correspondence schemes: how bonds see deformation and how stress becomes force."""
