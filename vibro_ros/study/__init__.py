"""Offline tools: benchmarks, reports, plots, the demo."""
