"""What every executable shares with its system.

`executables.py` is the list: setup.py installs by it, and documents and tests name them by it. Whoever starts an
executable enters by `entry_point.py:enter`, before anything that takes long to import: it takes the stop signals,
opens the streams, imports the module, runs its `main`, and turns errors into one line and an exit code: 0 done, 1
failed, 2 bad input, 128 + n stopped by signal n. A `main` that must close something well enters a `StopRequest`; a
long computation calls `interrupt_again`. `files.py` is for text and files that another hand may have written: shown
in one line of bounded length, opened only if they are regular files, replaced whole or not at all.
"""
