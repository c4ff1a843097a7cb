"""What a machine can do: sweeps, the optimum, branches of orbits, orbit diagrams, basins, command maps.

What comes in is a command line, ``study NAME ...``: a scene, what varies, and how much. What goes out are Parquet files
that say units and meanings, a picture, and sentences on standard output.

A study is a file whose `main` is a `command.StudyCommand`: its own options, the *design* that they give, which decides
all its numbers, and its results. From the design it makes a `table.Study`: the columns, and the rows of the point of a
number. `table.computed` reads the blocks of points that are whole in the output folder, has the others computed by an
`execution.Execution` (processes here, or a Dask cluster), and writes each block at once, so that the same command goes
on where it was stopped. Then come the result, its words and its picture.

Read `table` first, then `sweep`, the plainest study, and `execution` for who computes. `command` has what all command
lines share, `variation` axes and ranges, `measures` what one run gives; `optimise` searches the robots of `space` by
their `trials`. Where several starts are run, the result is a row for each motion (`orbits.attractors`), never a mean.
"""
