"""Write, seal and read recordings: rosbag2 folders (MCAP) made and read with rosbags. No rclpy here.

Serialised messages with their stamps come in, a folder of MCAP files and a metadata.yaml goes out, and back.
Begin with `recorder`: `Recorder.write` queues a message, a thread gives it to `mcap.writer.Writer` and flushes every
0.05 s, so that a killed robot loses no more. `folders` names the folder, and says whether somebody still writes to it.
The way back is `mcap_file`: one file of unknown origin, record by record, sealed or not; a damaged chunk costs that
chunk. `stream` puts the files of a folder in the order of time and names what cannot be read; `reader` makes numpy
arrays of its messages, which is `vibro_ros.read_bag`. `metadata` is metadata.yaml as rosbag2 writes it.
Nothing here knows what a robot does: what a recording means is the business of the room `recordings`.
"""
