"""Segments images into masks for the recalibration: automatic mask generation, its backends, and the ROS nodes.

Only `node` and `player` know ROS; only `backends.onnx` and `backends.torch` need a model.
"""
