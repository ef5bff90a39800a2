"""What several benchmarks need: blocks of points, the cases of verification, and the parts of studies."""
