"""Parameter studies of a machine: sweeps, optimisation, branches of orbits, orbit diagrams, basins, maps of motions.

A command line comes in, ``study NAME ...``: a scene, and the parameters to vary with their values. Parquet files whose
columns have units and meanings, a picture, and text on standard output go out.

A study is a module whose `main` is a `command.StudyCommand`: its own options, the *design* made from them, which
determines all its numbers, and its results. From the design it makes a `table.Study`: the columns, and a function from
the number of a point to its rows. `table.computed` reads the blocks of points that are complete in the output folder,
lets an `execution.Execution` (processes of this machine, or a Dask cluster) compute the others, and writes each block
when it is done, so that the same command resumes where it was stopped. Then follow results, text and picture.

Read `table` first, then `sweep`, the simplest study, and `execution` for the distribution of work. `command` has the
parts common to all command lines, `variation` axes and ranges, `measures` the results of one run, and `figures` the
style of pictures. If several starts are run, the result has a row for each motion (`orbits.attractors`), never a mean
over motions.
"""
