"""Speed and accuracy, measured: ``python -m benchmarks`` for speed, single modules for the others. See README.md."""
