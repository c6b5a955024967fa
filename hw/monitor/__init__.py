"""What reads the electrode's own voltage and current."""
