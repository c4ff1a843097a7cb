"""Start and end of every executable, untrusted text and files, and pictures.

`executables.py` lists the executables, for setup.py, documents and tests. Every executable starts with
`entry_point.py:enter`, before anything that takes long to import. It handles the stop signals, opens the streams,
imports the module, runs its `main`, and turns errors into one line and an exit code: 0 done, 1 failed, 2 bad input,
128 + n stopped by signal n. A `main` that must close something, such as a bag, enters a `StopRequest`; a long
computation calls `interrupt_again`. `files.py` handles untrusted text and files: text is shown in one line of bounded
length, a file is opened only if it is a regular file, and replaced whole or not at all. `files.py:user_path` expands
`~` in every path that a user gives. `pictures.py` makes pictures that do not depend on the user's settings of
matplotlib.
"""
