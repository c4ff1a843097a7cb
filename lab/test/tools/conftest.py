"""The fixtures `known_run` and `record_run` for the tests of this folder."""

from known_recording import known_run, record_run  # noqa: F401
