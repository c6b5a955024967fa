"""Links and instruments that fail, record, replay or exist in memory only."""
