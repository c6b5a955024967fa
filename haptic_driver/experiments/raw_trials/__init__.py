"""A lab's raw trial files -> rows of measured data, as a map says.

Read `trial_map` (what the map may say), `columns` (a file's columns as arrays), `cut` (windows of a
trial as rows) and `propose` (a map from the look of a file), in this order.
"""
