"""What the command lines of all executables share."""

import argparse


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are one line, said by `front_door.exit_code`."""

    def error(self, message: str) -> None:
        """Raise `message` as the ValueError that bad input is everywhere else."""
        raise ValueError(f"{message}; `{self.prog} --help` shows what there is")
