"""Whether the model is enough, and what it lacks if not."""
