"""What a machine can do: sweeps, the optimum, branches of orbits, orbit diagrams, basins, command maps.

What comes in is a command line, ``study NAME ...``: a scene, what varies, and how much. What goes out are Parquet files
that say units and meanings, a picture, and sentences on standard output.

A study is a folder with its `command.main`. It makes a *design*, all that decides its numbers, and from it a
`table.Study`: the columns, and the rows of the point of a number. `table.computed` reads the blocks of points that are
whole in the output folder, has the others computed by an `execution.Execution` (processes here, or a Dask cluster), and
writes each block at once, so that the same command goes on where it was stopped. The folder's `result` makes words and
pictures of the table.

Read `table` first, then `sweep/design.py`, the plainest study, and `execution` for who computes.
"""
