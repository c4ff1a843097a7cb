"""Write, seal and read recordings: rosbag2 folders (MCAP) made and read with rosbags. No rclpy here.

To record, serialised messages with their stamps come in, and a folder of MCAP files with a metadata.yaml goes out; to
read, the reverse. Read `recorder` first: `Recorder.write` queues a message, and a thread writes it with
`mcap.writer.Writer` and flushes every 0.05 s, so that a killed robot loses no more than 0.1 s. `folders` names the
folder, and says whether a process still writes to it. `mcap_file` reads one file of unknown origin, sealed or not; a
damaged chunk costs only that chunk. `stream` yields the messages of all files of a folder in time
order, and names what cannot be read; `reader` makes numpy arrays of them for `vibro_ros.read_bag`. `metadata` is
metadata.yaml as rosbag2 writes it. What a recording means for the robot is the business of the room `recordings`.
"""
