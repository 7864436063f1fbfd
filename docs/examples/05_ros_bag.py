"""
A ROS bag
=========

Bags of ROS 1 and 2 with ``sensor_msgs/Imu`` are read without ROS: ``pip install '.[ros]'``. This writes one as a
driver would, reads it, and draws the path.
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

import fg_nav

walk = fg_nav.simulate("demo", seed=1).recording.slice(0, 4000)
store, kind = get_typestore(Stores.ROS2_HUMBLE), "sensor_msgs/msg/Imu"
geometry = "geometry_msgs/msg"
words = (kind, "std_msgs/msg/Header", "builtin_interfaces/msg/Time", f"{geometry}/Vector3", f"{geometry}/Quaternion")
Imu, Header, Time, Vector, Attitude = (store.types[word] for word in words)
level, unknown = Attitude(0, 0, 0, 1), np.zeros(9)

with TemporaryDirectory() as place:
    bag = Path(place) / "walk"
    with Writer(bag, version=9) as writer:
        topic = writer.add_connection("/foot/imu", kind, typestore=store)
        for t, acc, gyr in zip(walk.t, walk.acc, walk.gyr, strict=True):
            ns = round(t * 1e9)
            header = Header(Time(ns // 10**9, ns % 10**9), "imu")
            message = Imu(header, level, unknown, Vector(*gyr), unknown, Vector(*acc), unknown)
            writer.write(topic, ns, store.serialize_cdr(message, kind))
    recording = fg_nav.read(bag)

print(recording.provenance.format, len(recording), "samples")
result = fg_nav.navigate(recording, "inertial")
print(result)
axes = result.plot()
