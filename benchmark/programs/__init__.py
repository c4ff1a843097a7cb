"""A program a module, with `SETTINGS`, `version()` and `prepare(problem, setting)` as `accuracy.programs` says.

Each module imports its program, so that it is imported in a process of its own alone (`benchmark.child`).
"""
