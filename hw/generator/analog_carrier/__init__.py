"""A carrier that a card makes sample by sample: no instrument with words in between."""
