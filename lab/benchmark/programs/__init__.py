"""The programs, one in each module, with `SETTINGS`, `version()` and `prepare(problem, setting)` as `accuracy.programs`
says.

Each module imports its program, and is therefore imported only in a process of its own (`benchmark.child`).
"""
