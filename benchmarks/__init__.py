"""Speed, as ratios measured in one run: `make bench`, or `python -m benchmarks`; figures in docs/benchmarks.md."""
