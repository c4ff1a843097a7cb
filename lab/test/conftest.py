"""The set-up of every test, which lab/test shares."""

pytest_plugins = ["every_test"]
