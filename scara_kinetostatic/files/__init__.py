"""Files that a user writes or reads: the cell description; safe YAML, atomic writing."""
