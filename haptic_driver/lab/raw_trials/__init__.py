"""A lab's raw trial files become rows of measured data, by the rules of a map.

Read the modules in this order:

- `trial_map`: what the map may say;
- `layout`: where the table of a text stands;
- `columns`: a file's columns as arrays;
- `cut`: windows of a trial as rows;
- `strokes`: windows of a trial as strokes over a surface;
- `propose`: a map from the look of a file.
"""

__all__ = ["columns", "cut", "folder", "propose", "trial_map"]
