"""How far other forms of an effect, and what is no effect, are from the catalogue."""
