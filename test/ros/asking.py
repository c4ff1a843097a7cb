"""A request to a service, with its answer."""

import time

AGAIN = 5.0  # s
"""DDS drops a request, or its answer, if server and client know each other on one side only, as on a busy machine."""


def answer_of(bench, kind: type, name: str, **fields):
    """The answer of the service `name`; the request is repeated until it comes, so it must not matter how often."""
    client = bench.node.create_client(kind, name)
    bench.spin_until(client.service_is_ready, name)
    futures, asked = [], 0.0

    def answered() -> bool:
        nonlocal asked
        if time.monotonic() >= asked + AGAIN:
            asked = time.monotonic()
            futures.append(client.call_async(kind.Request(**fields)))
        return any(future.done() for future in futures)

    bench.spin_until(answered, f"answer of {name}")
    bench.node.destroy_client(client)
    return next(future.result() for future in futures if future.done())
