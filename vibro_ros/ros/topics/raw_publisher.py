"""Publishing bytes that stay where they are, by rcl itself.

rclpy's `publish` looks at the message's class, locks its handle and copies the bytes before it calls the same function.
In a thread that wakes for each tick this costs as much as the write by DDS: none of its code is in the processor's
caches by then.
"""

import ctypes

import numpy as np
from rclpy.publisher import Publisher

_SIZE = ctypes.c_size_t
_ADDRESS = ctypes.c_void_p


class _SerialisedMessage(ctypes.Structure):
    """rcl_serialized_message_t, with an allocator that nobody calls."""

    _fields_ = (("buffer", _ADDRESS), ("buffer_length", _SIZE), ("buffer_capacity", _SIZE), ("allocator", _ADDRESS * 5))


# The library that rclpy has loaded. The call keeps the interpreter's lock, as rclpy's does.
_publish = ctypes.PyDLL("librcl.so").rcl_publish_serialized_message
_publish.argtypes, _publish.restype = (_ADDRESS, _ADDRESS, _ADDRESS), ctypes.c_int


class RawPublisher:
    """Publishes what lies in an array at that moment; for one thread, which must end before the publisher.

    Parameters
    ----------
    publisher : Publisher
        What publishes.
    data : ndarray of uint8, shape (n,)
        The serialised message, contiguous.
    """

    def __init__(self, publisher: Publisher, data: np.ndarray):
        self._publisher, self._data = publisher, data
        self._message = _SerialisedMessage(data.ctypes.data, data.nbytes, data.nbytes)
        self._arguments = publisher.handle.pointer, ctypes.addressof(self._message), None

    def publish(self) -> None:
        """Publish once (RuntimeError when ROS cannot)."""
        if _publish(*self._arguments):
            self._publisher.publish(self._data.tobytes())  # which says why
