"""The fixture `record_run` for the tests of this folder."""

from known_recording import record_run  # noqa: F401
