"""Compiled kernels, and the algebra of small vectors and tensors that they share."""
