"""What every executable shares with its system: arguments, exit codes, streams, stop signals, files of other hands."""
