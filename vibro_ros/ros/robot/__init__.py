"""The robot executable: steps the device in real time, serves requests, records."""
