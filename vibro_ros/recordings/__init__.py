"""What is done with a recording: report, replay, recover, compare, vary."""
