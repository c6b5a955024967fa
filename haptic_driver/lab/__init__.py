"""The laboratory: what is done with the driver, beside it.

- `measuring` takes a plan to a rig and brings back a table of data, with its `strokes`;
- `raw_trials` reads other laboratories' files, `contact` films of the touch, and `importers` what
  becomes a texture, both by `images`;
- `psychophysics` does experiments with people;
- `figures` and `pictures` draw, `papers` write what a rig may do and does;
- `challenge` makes and scores a benchmark of diagnoses;
- `studies` look at a population of fingers; `findings` say what data mean, for Python;
- `commands` are what the command line has of all this.

One rule holds: nothing of the driver imports this floor.
"""
