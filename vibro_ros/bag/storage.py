"""rosbags' MCAP writer, made to lose at most the last moments when its process is killed.

rosbags keeps up to 1 MiB of messages in memory before it writes a chunk, so a quiet robot would
lose minutes. `FlushedMcap` closes the chunk and flushes the file whenever it is told to. It
touches internals of rosbags, so rosbags is pinned, and test/bag/test_storage.py holds the contract.
"""

from functools import cache
from io import BytesIO
from pathlib import Path

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionMode
from rosbags.rosbag2.storage_mcap import Channel, McapWriter, write_channel, write_string
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

BAG_VERSION = 9  # metadata version of ROS 2 Jazzy

_FOREVER = QosTime(9223372036, 854775807)  # how ROS writes "no deadline"


@cache
def jazzy_types() -> Typestore:
    """Message definitions of ROS 2 Jazzy, loaded once (about 60 ms)."""
    return get_typestore(Stores.ROS2_JAZZY)


def reliable_qos(depth: int) -> Qos:
    """The QoS profile that the robot offers: reliable, volatile, the last `depth` messages kept."""
    return Qos(QosHistory.KEEP_LAST, depth, QosReliability.RELIABLE, QosDurability.VOLATILE,
               _FOREVER, _FOREVER, QosLiveliness.AUTOMATIC, _FOREVER, False)


class FlushedMcap(McapWriter):
    """MCAP storage whose chunks are closed and flushed on demand, named and labelled as rosbag2 does."""

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        # rosbag2 numbers its files: <bag>_0.mcap
        self.path = self.path.rename(path / f"{path.name}_0.mcap")

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Announce a topic, with the type hash that rosbag2 (Jazzy) keeps beside its QoS."""
        labels = BytesIO()
        for text in ("offered_qos_profiles", offered_qos_profiles, "topic_type_hash", connection.digest):
            write_string(labels, text)
        channel = Channel(connection.id, connection.msgtype, connection.topic,
                          connection.ext.serialization_format, labels.getvalue())
        self.channels.append(channel)
        self.channel_stats[connection.id] = 0
        write_channel(self.chunk.bio, channel, self.schemas)

    def close_chunk(self) -> None:
        """Write the pending chunk to the file."""
        if not self.chunk.msgs:
            self.chunk.message_start_time = 0  # the MCAP standard's value for a chunk without messages
        super().close_chunk()

    def flush(self) -> None:
        """Hand everything written so far to the operating system: a killed process no longer loses it.

        Raises
        ------
        OSError
            When the disk is full, or the file is no longer where it was made.
        """
        if self.chunk.bio.tell():
            self.close_chunk()
        self.bio.flush()
        self.path.stat()  # writing to a removed file succeeds: notice it here

    def close(self, version: int, metadata: str) -> None:
        """Write the index and the footer."""
        if not any(self.channel_stats.values()):
            self.message_start_time = 0
        super().close(version, metadata)


class FlushedWriter(Writer):
    """rosbags' bag writer on `FlushedMcap`."""

    STORAGE_PLUGINS = {StoragePlugin.MCAP: FlushedMcap}

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)

    def flush(self) -> None:
        """Make everything written so far survive the end of this process (OSError: see `FlushedMcap.flush`)."""
        self.storage.flush()

    def close(self) -> None:
        """Write index, footer and metadata.yaml: the bag is sealed."""
        if not any(self.counts.values()):
            self.min_timestamp = 0  # else an empty bag would begin in the year 2262
        super().close()
