"""What studies and benchmarks share: scenes, references, timing and how results are written."""
