"""Measuring: methods on drawn clips, a judge that none of them knows, timings; it makes docs/benchmarks.md."""
